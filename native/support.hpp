// SPDX-License-Identifier: Apache-2.0
// The edges of an image along a carried outline. Defined in kernels/reference_support.py.
#pragma once

#include "edges.hpp"
#include "evidence.hpp"
#include "outline.hpp"
#include "registration.hpp"

namespace grasptrack {

struct SupportRules {
    double area, reach_share, least_reach, most_reach, least_strength, relative_strength, other_ground, loose;
    int polarity;
};

struct SupportArrays {  // of the samples, in their order
    Vec *points, *normals;
    Edge *edges;
    bool *inside, *found;
};

struct SupportValues {
    double size = 0.0, reach = 0.0;
};

// Edges with the same ground beyond them as most: the same level, or as much lighter as the object is there.
inline std::vector<bool> on_the_ground(const Edge *edges, const bool *found, std::size_t m, double other_ground) {
    std::vector<double> within, beyond;
    for (std::size_t i = 0; i < m; ++i)
        if (found[i]) within.push_back(edges[i].inside), beyond.push_back(edges[i].outside);
    std::vector<bool> out(m, false);
    if (within.empty()) return out;
    const double dark = median_of(within), light = median_of(beyond);
    for (double &b : beyond) b = std::fabs(b - light);
    const double tolerance = std::max(other_ground * std::fabs(light - dark), 4.0 * 1.4826 * median_of(beyond));
    for (std::size_t i = 0; i < m; ++i) {
        const double lit = light * edges[i].inside / std::max(dark, 1.0);
        out[i] = std::fabs(edges[i].outside - light) <= tolerance || std::fabs(edges[i].outside - lit) <= tolerance;
    }
    return out;
}

inline SupportValues outline_support(const Image<std::uint8_t> &image, const double *H, const double *points,
                                     const double *normals, const double *strength, std::size_t m,
                                     const double *contacts, std::size_t k, const SupportRules &rules,
                                     const SupportArrays &out, double *shift, double *covariance) {
    std::vector<double> moved(5 * m);
    carry_normals(H, points, normals, static_cast<std::int64_t>(m), moved.data());
    SupportValues values;
    double scale = 0.0;
    Vec centre{0, 0};
    for (std::size_t i = 0; i < m; ++i) {
        out.points[i] = {moved[5 * i], moved[5 * i + 1]};
        out.normals[i] = {moved[5 * i + 2], moved[5 * i + 3]};
        scale += moved[5 * i + 4];
        centre = centre + out.points[i];
    }
    values.size = std::sqrt(rules.area * std::fabs(scale / static_cast<double>(m)));
    if (!(values.size > 0)) return {};
    centre = (1.0 / static_cast<double>(m)) * centre;
    values.reach = std::min(std::max(rules.reach_share * values.size, rules.least_reach), rules.most_reach);
    const auto direction = [&](std::size_t i) {
        if (rules.polarity != 0 || std::isinf(strength[i])) return rules.polarity;
        return strength[i] > 0 ? 1 : -1;
    };
    edge_search_each(image, {out.points, m}, out.normals, values.reach + 2.0, direction, out.edges);

    std::vector<double> gains;
    double spread = 0.0;
    for (std::size_t i = 0; i < m; ++i) {
        const Vec p = out.points[i];
        spread += dot(p - centre, p - centre);
        out.inside[i] = p.x >= 1 && p.y >= 1 && p.x <= static_cast<double>(image.width - 2) &&
                        p.y <= static_cast<double>(image.height - 2);
        const double size = std::fabs(out.edges[i].strength);
        out.found[i] = out.inside[i] && std::fabs(out.edges[i].offset) <= values.reach && size >= rules.least_strength;
        if (out.found[i]) gains.push_back(size / std::fabs(strength[i]));
    }
    const double gain = gains.empty() ? 0.0 : median_of(gains);
    for (std::size_t i = 0; i < m; ++i) {
        const double wanted = std::isinf(strength[i]) ? 0.0 : rules.relative_strength * gain * std::fabs(strength[i]);
        out.found[i] = out.found[i] && std::fabs(out.edges[i].strength) >= wanted;
    }
    const std::vector<bool> ground = on_the_ground(out.edges, out.found, m, rules.other_ground);
    std::vector<Vec> at, along;
    std::vector<double> offsets;
    for (std::size_t i = 0; i < m; ++i)
        if (out.found[i] && ground[i]) {
            at.push_back(out.points[i]);
            along.push_back(out.normals[i]);
            offsets.push_back(out.edges[i].offset);
        }
    const double radius = std::sqrt(spread / static_cast<double>(m));
    const auto *p = reinterpret_cast<const double *>(at.data()), *n = reinterpret_cast<const double *>(along.data());
    projective_step(p, n, offsets.data(), static_cast<std::int64_t>(at.size()), contacts, static_cast<std::int64_t>(k),
                    radius, rules.loose * values.size, shift, covariance);
    return values;
}

}  // namespace grasptrack
