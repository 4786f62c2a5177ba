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

// Forward-backward. The occluder's likelihood is 1; `power`: how much of an independent measurement a sample is; `mixed`:
// factor of the probability that an occluder and another shape lie side by side, without the object's edge between them.
inline Chain stretches(const std::vector<double> &object, const std::vector<double> &other, double power, const States &share,
                       double stay, bool backward, double mixed = 1.0) {
    const std::size_t n = object.size();
    Chain out;
    out.posterior.resize(n);
    std::vector<States> likelihood(n);
    States before = share;
    for (std::size_t i = 0; i < n; ++i) {
        likelihood[i] = {std::pow(object[i], power), 1.0, std::pow(other[i], power)};
        States a;
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const double beside = k == 0 ? 0.0 : (1 - mixed) * before[3 - k];
            const double t = i == 0 ? before[k] : stay * before[k] + (1 - stay) * share[k] * (1 - beside);
            sum += a[k] = t * likelihood[i][k];
        }
        for (double &value : a) value /= sum;
        out.log_likelihood += std::log(sum);
        out.posterior[i] = before = a;
    }
    if (!backward) return out;
    States b{1, 1, 1};
    for (std::size_t i = n; i-- > 0;) {
        if (i + 1 < n) {
            const States &L = likelihood[i + 1];
            const States to{share[0] * L[0] * b[0], share[1] * L[1] * b[1], share[2] * L[2] * b[2]};
            const double m = to[0] + to[1] + to[2];
            double sum = 0;
            for (std::size_t k = 0; k < 3; ++k) {
                const double beside = k == 0 ? 0.0 : (1 - mixed) * to[3 - k];
                sum += b[k] = stay * L[k] * b[k] + (1 - stay) * (m - beside);
            }
            for (double &value : b) value *= 3 / sum;
        }
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) sum += out.posterior[i][k] *= b[k];
        for (double &value : out.posterior[i]) value /= sum;
    }
    return out;
}

}  // namespace grasptrack::pose
