// SPDX-License-Identifier: Apache-2.0
// What the edges found along a carried outline say for it and against it. Defined in kernels/reference_weighing.py.
#pragma once

#include "contradiction.hpp"

namespace grasptrack {

constexpr double kHopeless = 0.5, kBeside = 1.75, kClear = 3.0, kMaterial = 0.3;
constexpr std::size_t kLeast = 8;

struct FoundEdges {  // of m samples, of which the first n go round the outline
    const Vec *points, *normals;
    const Edge *edges;
    const bool *inside, *found;
    const double *reference_inside, *reference_outside;
    std::size_t m, n;
    int polarity;
    double reach, size;
};

struct Weights {
    double share = 0.0, visible = 0.0;
    double rms = std::numeric_limits<double>::infinity(), spread = std::numeric_limits<double>::infinity();
    double against = 0.0;
    double dark = std::numeric_limits<double>::quiet_NaN(), light = std::numeric_limits<double>::quiet_NaN();
};

// NaN among the values is their median, as NumPy has it.
inline double median_or_nan(std::vector<double> &values) {
    for (const double v : values)
        if (std::isnan(v)) return v;
    return median_of(values);
}

// Grey levels to expect at each sample; NaN where they tell nothing.
inline void expected_levels(const FoundEdges &in, std::vector<double> &ground, std::vector<double> &material) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    ground.assign(in.m, nan);
    material.assign(in.m, nan);
    std::vector<double> values;
    const auto median = [&](auto value) {
        values.clear();
        for (std::size_t i = 0; i < in.m; ++i)
            if (in.found[i]) values.push_back(value(i));
        return median_or_nan(values);
    };
    if (static_cast<std::size_t>(std::count(in.found, in.found + in.m, true)) < kLeast) return;
    const double light = median([&](std::size_t i) { return in.edges[i].outside; });
    const double spread = 1.4826 * median([&](std::size_t i) { return std::fabs(in.edges[i].outside - light); });
    if (in.polarity != 0) {
        const double darker = median([&](std::size_t i) { return in.edges[i].inside - in.reference_inside[i]; });
        for (std::size_t i = 0; i < in.m; ++i) material[i] = in.reference_inside[i] + darker;
    } else {  // what is lighter and what is darker than the ground changes alike
        const double usual = median([&](std::size_t i) { return in.reference_outside[i]; });
        double most = nan;
        for (std::size_t i = 0; i < in.m; ++i)
            if (in.found[i]) most = std::fmax(most, std::fabs(in.reference_inside[i] - usual));
        values.clear();
        for (std::size_t i = 0; i < in.m; ++i) {
            const double then = in.reference_inside[i] - usual;
            if (in.found[i] && std::fabs(then) >= 0.5 * most) values.push_back((in.edges[i].inside - light) / then);
        }
        const double gain = median_or_nan(values);
        for (std::size_t i = 0; i < in.m; ++i) material[i] = light + gain * (in.reference_inside[i] - usual);
    }
    for (std::size_t i = 0; i < in.m; ++i)
        if (std::fabs(light - material[i]) > kClear * spread) ground[i] = light;
}

// `beside` and `known` are of the outline's samples, `against` too; `seen` is of the contacts.
inline Weights weigh_edges(const FoundEdges &in, const Levels &levels, const bool *beside, const bool *known,
                           std::size_t contacts, double *seen, bool *against) {
    Weights out;
    std::vector<double> ground, material;
    expected_levels(in, ground, material);
    std::vector<char> found(in.found, in.found + in.m);
    for (std::size_t i = 0; i < in.m; ++i) {
        if (!found[i]) continue;
        const Edge &edge = in.edges[i];
        const double within = levels.image_at(in.points[i] + (edge.offset - kBeside) * in.normals[i]);
        // in shadow both sides are darker
        const double lit = std::min(std::max(edge.outside / std::max(ground[i], 1.0), 0.0), 1.0);
        if (in.polarity != 0) {
            found[i] = !(std::fabs(within - lit * ground[i]) < std::fabs(within - lit * material[i]));
        } else {
            found[i] = !(std::fabs(within - edge.outside) < kMaterial * lit * std::fabs(material[i] - ground[i]));
        }
    }
    std::vector<double> hits;
    std::vector<char> missed(in.n), told(in.n, 0);
    std::size_t asked = 0, count = 0;
    double squares = 0.0;
    for (std::size_t i = 0; i < in.n; ++i) {
        asked += in.inside[i] ? 1 : 0;
        missed[i] = in.inside[i] && !found[i];
        count += missed[i] ? 1 : 0;
        if (!found[i]) continue;
        hits.push_back(std::fabs(in.edges[i].offset));
        squares += hits.back() * hits.back();
    }
    if (static_cast<double>(count) <= kHopeless * static_cast<double>(in.m)) {
        const Expected outline{in.points, in.normals, material.data(), ground.data(), in.n, in.reach, in.size};
        if (count > 0) contradicted(levels, outline, missed, told);
        if (in.polarity == 0) {
            std::vector<char> more(in.n, 0);
            attached(levels, outline, more);
            for (std::size_t i = 0; i < in.n; ++i) told[i] = told[i] || (more[i] && in.inside[i] && !beside[i]);
        }
    }
    std::size_t contrary = 0;
    for (std::size_t i = 0; i < in.n; ++i) {
        against[i] = told[i] && !known[i];
        contrary += against[i] ? 1 : 0;
    }
    const std::size_t each = (in.m - in.n) / contacts;
    for (std::size_t c = 0; c < contacts; ++c) {
        const auto first = found.begin() + static_cast<std::ptrdiff_t>(in.n + c * each);
        seen[c] = static_cast<double>(std::count(first, first + static_cast<std::ptrdiff_t>(each), 1)) /
                  static_cast<double>(each);
    }
    out.visible = static_cast<double>(asked) / static_cast<double>(in.n);
    if (asked > 0) {
        out.share = static_cast<double>(hits.size()) / static_cast<double>(asked);
        out.against = static_cast<double>(contrary) / static_cast<double>(asked);
    }
    if (!hits.empty()) {
        out.rms = std::sqrt(squares / static_cast<double>(hits.size()));
        const auto place = hits.begin() + static_cast<std::ptrdiff_t>(9 * hits.size() / 10);
        std::nth_element(hits.begin(), place, hits.end());
        out.spread = *place;
    }
    std::vector<double> dark, light;
    for (std::size_t i = 0; i < in.m; ++i)
        if (found[i]) dark.push_back(in.edges[i].inside), light.push_back(in.edges[i].outside);
    out.dark = median_or_nan(dark);
    out.light = median_or_nan(light);
    return out;
}

}  // namespace grasptrack
