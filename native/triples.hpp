// SPDX-License-Identifier: Apache-2.0
// Triples of contacts that close while all fingers push toward their mean, or all away from it, without slipping.
#pragma once

#include <array>
#include <vector>

#include "wrench.hpp"

namespace grasptrack {

constexpr double least_epsilon = 1e-6;

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

}  // namespace grasptrack
