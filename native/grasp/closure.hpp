// SPDX-License-Identifier: Apache-2.0
// Force closure: the convex hull of the contact wrenches, and the friction that it takes ([12], [14]).
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "../geometry/points.hpp"

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

// Triples of contacts that close while all fingers push toward their mean, or all away from it, without slipping.

constexpr double least_epsilon = 1e-6;
constexpr std::size_t most_tripled = 256, most_paired = 20000;  // candidates: what takes seconds

struct Triple {
    std::array<std::int64_t, 3> index;
    double sense, epsilon;
};

inline std::vector<Triple> closing_triples(Points contacts, const Vec *normals, Vec centre, double rho, double friction) {
    std::vector<Triple> found;
    const std::size_t n = contacts.size;
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = i + 1; j < n; ++j)
            for (std::size_t k = j + 1; k < n; ++k) {
                const Vec at[3] = {contacts[i], contacts[j], contacts[k]};
                const Vec along[3] = {normals[i], normals[j], normals[k]};
                const Vec mean = (1.0 / 3.0) * (at[0] + at[1] + at[2]);
                int toward = 0, away = 0;
                for (int f = 0; f < 3; ++f) {
                    const double straight = dot(along[f], mean - at[f]);
                    const double aside = std::fabs(cross(along[f], mean - at[f]));
                    toward += aside < friction * straight, away += aside < -friction * straight;
                }
                if (toward != 3 && away != 3) continue;
                // forces that all have a part in one direction cannot balance
                const Vec sum = along[0] + along[1] + along[2];
                bool one_way = true;
                for (int f = 0; f < 3; ++f)
                    one_way &= dot(along[f], sum) >= friction * std::fabs(cross(along[f], sum));
                if (one_way) continue;
                Vec arms[3];
                for (int f = 0; f < 3; ++f) arms[f] = (1 / rho) * (at[f] - centre);
                const double epsilon = Hull(arms, along, 3, 1.0, friction).depth(true);
                if (epsilon > least_epsilon)
                    found.push_back({{static_cast<std::int64_t>(i), static_cast<std::int64_t>(j),
                                      static_cast<std::int64_t>(k)},
                                     toward == 3 ? 1.0 : -1.0,
                                     epsilon});
            }
    return found;
}

// Pairs of contacts whose friction cones hold the line between them.

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
