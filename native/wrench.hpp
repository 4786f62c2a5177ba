// SPDX-License-Identifier: Apache-2.0
// Force closure: the convex hull of the contact wrenches, and the friction that it takes ([12], [14]).
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "geometry.hpp"

namespace grasptrack {

constexpr std::size_t max_contacts = 8;
constexpr double on_plane = 1e-12;  // relative to the largest wrench
constexpr double no_plane = 1e-9;
constexpr double half_pi = 1.57079632679489661923;

struct Wrench {
    double x, y, z;
};

inline Wrench operator-(Wrench a, Wrench b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline double dot(Wrench a, Wrench b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Wrench cross(Wrench a, Wrench b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

struct Hull {
    std::array<Wrench, 2 * max_contacts> w;
    std::size_t size;

    // Edges of the friction cones: force n * along +- t * across, torque / rho.
    Hull(const Vec *arms, const Vec *normals, std::size_t count, double along, double across) : size(2 * count) {
        for (std::size_t i = 0; i < count; ++i) {
            const Vec n = normals[i], t{-n.y, n.x};
            const Vec f = along * n + across * t, g = along * n - across * t;
            w[i] = {f.x, f.y, cross(arms[i], f)};
            w[count + i] = {g.x, g.y, cross(arms[i], g)};
        }
    }

    // Signed distance of the origin from the nearest facet, positive inside; 0 where the hull is flat. Who only wants to
    // know whether the origin is inside needs no more than one facet that it is beyond.
    double depth(bool only_inside = false) const {
        double scale = 0;
        for (std::size_t i = 0; i < size; ++i)
            scale = std::max({scale, std::fabs(w[i].x), std::fabs(w[i].y), std::fabs(w[i].z)});
        if (scale == 0) return 0.0;
        double least = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < size; ++i)
            for (std::size_t j = i + 1; j < size; ++j)
                for (std::size_t k = j + 1; k < size; ++k) {
                    Wrench m = cross(w[j] - w[i], w[k] - w[i]);
                    const double norm = std::sqrt(dot(m, m));
                    if (norm <= no_plane * scale * scale) continue;
                    m = {m.x / norm, m.y / norm, m.z / norm};
                    bool above = false, below = false;
                    for (std::size_t l = 0; l < size && !(above && below); ++l) {
                        const double height = dot(w[l] - w[i], m);
                        above |= height > on_plane * scale;
                        below |= height < -on_plane * scale;
                    }
                    if (!above && !below) return 0.0;
                    const double at = dot(w[i], m);
                    if (!above)
                        least = std::min(least, at);
                    else if (!below)
                        least = std::min(least, -at);
                    if (only_inside && least <= 0) return least;
                }
        return std::isfinite(least) ? least : 0.0;
    }
};

inline double angle_between(Vec a, Vec b) { return std::fabs(std::atan2(cross(a, b), dot(a, b))); }

inline double friction_angle(const Vec *contacts, const Vec *normals, const Vec *arms, std::size_t count) {
    if (count == 2) {
        const Vec d = contacts[1] - contacts[0];
        if (d.x == 0 && d.y == 0) return half_pi;
        const double squeeze = std::max(angle_between(normals[0], d), angle_between(normals[1], -d));
        const double spread = std::max(angle_between(normals[0], -d), angle_between(normals[1], d));
        return std::min({squeeze, spread, half_pi});
    }
    const auto closes = [&](double angle) {
        return Hull(arms, normals, count, std::cos(angle), std::sin(angle)).depth() > on_plane;
    };
    double low = 0, high = half_pi - 1e-9;
    if (closes(low)) return 0.0;
    if (!closes(high)) return half_pi;
    while (high - low > 1e-9) {
        const double middle = 0.5 * (low + high);
        (closes(middle) ? high : low) = middle;
    }
    return high;
}

struct Closure {
    double epsilon, friction_angle;
};

inline Closure force_closure(const Vec *contacts, const Vec *normals, std::size_t count, Vec centre, double rho,
                             double friction) {
    std::array<Vec, max_contacts> arms;
    for (std::size_t i = 0; i < count; ++i) arms[i] = (1 / rho) * (contacts[i] - centre);
    return {Hull(arms.data(), normals, count, 1.0, friction).depth(),
            friction_angle(contacts, normals, arms.data(), count)};
}

}  // namespace grasptrack
