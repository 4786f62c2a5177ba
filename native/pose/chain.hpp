// SPDX-License-Identifier: Apache-2.0
// Explanations of the outline come in stretches: a Markov chain along it, of three states.
#pragma once

#include <array>
#include <cmath>
#include <vector>

namespace grasptrack::pose {

using States = std::array<double, 3>;  // the object's edge, an occluder, another shape

struct Chain {
    double log_likelihood = 0;
    std::vector<States> posterior;
};

// Forward-backward, of likelihoods by state. `mixed`: factor of the probability that an occluder and another shape lie side by
// side, without the object's edge between them.
inline void explain(const std::vector<States> &likelihood, const States &share, double stay, bool backward, double mixed, Chain &out) {
    const std::size_t n = likelihood.size();
    out.posterior.resize(n);
    out.log_likelihood = 0;
    const double apart = 1 - mixed;
    const States drawn{(1 - stay) * share[0], (1 - stay) * share[1], (1 - stay) * share[2]};
    States before = share;
    double product = 1;  // of the sums: their logarithm now and then
    for (std::size_t i = 0; i < n; ++i) {
        const States &L = likelihood[i];
        States a;
        if (i == 0) {
            a = {share[0] * L[0], share[1] * L[1], share[2] * L[2]};
        } else {
            a = {(stay * before[0] + drawn[0]) * L[0], (stay * before[1] + drawn[1] * (1 - apart * before[2])) * L[1],
                 (stay * before[2] + drawn[2] * (1 - apart * before[1])) * L[2]};
        }
        const double sum = a[0] + a[1] + a[2], s = 1 / sum;
        out.posterior[i] = before = {a[0] * s, a[1] * s, a[2] * s};
        product *= sum;
        if (!(product > 1e-100 && product < 1e100)) {
            out.log_likelihood += std::log(product);
            product = 1;
        }
    }
    out.log_likelihood += std::log(product);
    if (!backward) return;
    States b{1, 1, 1};
    for (std::size_t i = n; i-- > 0;) {
        if (i + 1 < n) {
            const States &L = likelihood[i + 1];
            const States seen{L[0] * b[0], L[1] * b[1], L[2] * b[2]};
            const States to{drawn[0] * seen[0], drawn[1] * seen[1], drawn[2] * seen[2]};
            const double m = to[0] + to[1] + to[2];
            b = {stay * seen[0] + m, stay * seen[1] + m - apart * to[2], stay * seen[2] + m - apart * to[1]};
            const double s = 3 / (b[0] + b[1] + b[2]);
            for (double &value : b) value *= s;
        }
        States &p = out.posterior[i];
        p = {p[0] * b[0], p[1] * b[1], p[2] * b[2]};
        const double s = 1 / (p[0] + p[1] + p[2]);
        for (double &value : p) value *= s;
    }
}

// Likelihood ratios as so much of an independent measurement each.
inline void temper(std::vector<double> &ratios, double power) {
    for (double &value : ratios)
        if (value != 1.0) value = std::pow(value, power);
}

// The same, of likelihood ratios against an occluder.
inline Chain stretches(const std::vector<double> &object, const std::vector<double> &other, const States &share, double stay, bool backward,
                       double mixed) {
    std::vector<States> likelihood(object.size());
    for (std::size_t i = 0; i < object.size(); ++i) likelihood[i] = {object[i], 1.0, other[i]};
    Chain out;
    explain(likelihood, share, stay, backward, mixed, out);
    return out;
}

}  // namespace grasptrack::pose
