// SPDX-License-Identifier: Apache-2.0
// Pairs of contacts whose friction cones hold the line between them.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "geometry.hpp"

namespace grasptrack {

constexpr double strictly = 1 - 1e-6;  // of the friction: a contact on the edge of its cone is not stable

struct Opposition {
    double friction, sense;
};

// The friction that a pair needs, infinite where the normals neither face each other (sense 1) nor face away (-1).
inline Opposition opposition(Vec a, Vec na, Vec b, Vec nb) {
    const Vec d = b - a;
    const double p = dot(na, d), q = -dot(nb, d);
    if (!((p > 0 && q > 0) || (p < 0 && q < 0))) return {std::numeric_limits<double>::infinity(), 0.0};
    return {std::max(std::fabs(cross(na, d) / p), std::fabs(cross(nb, d) / q)), p > 0 ? 1.0 : -1.0};
}

struct Opposed {
    std::int64_t first, second;
    double sense, friction;
};

// What is common to the candidates of one group: a disc that holds them and a cone that holds their normals.
struct Bundle {
    Vec centre, normal;
    double radius, spread;

    Bundle(const Vec *contacts, const Vec *normals, std::size_t count) : centre{0, 0}, normal{0, 0}, radius(0), spread(0) {
        for (std::size_t i = 0; i < count; ++i) centre = centre + contacts[i], normal = normal + normals[i];
        centre = (1.0 / static_cast<double>(count)) * centre;
        const double size = length(normal);
        normal = size > 1e-9 ? (1 / size) * normal : Vec{1, 0};
        for (std::size_t i = 0; i < count; ++i) {
            radius = std::max(radius, length(contacts[i] - centre));
            spread = std::max(spread, std::atan2(std::fabs(cross(normal, normals[i])), dot(normal, normals[i])));
        }
    }
};

// Whether any pair of two bundles can be opposed; cos(x) >= 1 - x^2 / 2 and asin(x) <= pi x / 2 spare the functions.
inline bool may_oppose(const Bundle &a, const Bundle &b, double angle) {
    const Vec line = b.centre - a.centre;
    const double distance = length(line), radii = a.radius + b.radius;
    if (!(distance > radii)) return true;
    const double leaning = angle + 1.5708 * radii / distance + 1e-6;
    const double at_a = distance * (1 - (leaning + a.spread) * (leaning + a.spread) / 2);
    const double at_b = distance * (1 - (leaning + b.spread) * (leaning + b.spread) / 2);
    const double p = dot(a.normal, line), q = -dot(b.normal, line);
    return (p >= at_a && q >= at_b) || (-p >= at_a && -q >= at_b);
}

inline std::vector<Opposed> opposed_pairs(Points contacts, const Vec *normals, const double *worth, std::size_t group,
                                          double friction) {
    const std::size_t groups = contacts.size / group;
    const double angle = std::atan(friction), most = friction * strictly;
    std::vector<Bundle> bundles;
    bundles.reserve(groups);
    for (std::size_t g = 0; g < groups; ++g) bundles.emplace_back(contacts.data + g * group, normals + g * group, group);
    std::vector<Opposed> found;
    for (std::size_t g = 0; g < groups; ++g)
        for (std::size_t h = g; h < groups; ++h) {
            if (g != h && !may_oppose(bundles[g], bundles[h], angle)) continue;
            double best = 0;
            Opposed pair{-1, -1, 0, 0};
            for (std::size_t i = g * group; i < (g + 1) * group; ++i) {
                if (!(worth[i] > 0)) continue;
                for (std::size_t j = std::max(h * group, i + 1); j < (h + 1) * group; ++j) {
                    if (!(worth[j] > 0)) continue;
                    const Vec d = contacts[j] - contacts[i];
                    if (!(std::fabs(cross(normals[i], d)) <= friction * std::fabs(dot(normals[i], d)))) continue;
                    const Opposition here = opposition(contacts[i], normals[i], contacts[j], normals[j]);
                    if (!(here.friction < most)) continue;
                    const double least = std::min(worth[i], worth[j]);
                    const double score = (1 - here.friction / friction) * (least * least);
                    if (score > best) {
                        best = score;
                        pair = {static_cast<std::int64_t>(i), static_cast<std::int64_t>(j), here.sense, here.friction};
                    }
                }
            }
            if (pair.first >= 0) found.push_back(pair);
        }
    return found;
}

}  // namespace grasptrack
