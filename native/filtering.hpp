// SPDX-License-Identifier: Apache-2.0
// A robust extended Kalman filter: how it goes on, and one update by what was seen.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "linear.hpp"
#include "sightings.hpp"

namespace grasptrack {

// Lets a state go on, in place; drift, wander and twirl are spectral densities of what may happen meanwhile.
inline void advance_state(double *s, double *P, std::size_t n, double seconds, double drift, double wander,
                          double twirl) {
    const std::size_t m = unknown::shape + 2 * n, place = unknown::place, speed = unknown::speed;
    const double *axes = s + state::axes;
    for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t k = 0; k < 3; ++k)
            s[state::place + r] += seconds * axes[3 * r + k] * s[state::speed + k];
    for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t k = 0; k < 3; ++k)
            for (std::size_t c = 0; c < m; ++c)
                P[(place + r) * m + c] += seconds * axes[3 * r + k] * P[(speed + k) * m + c];
    for (std::size_t r = 0; r < m; ++r)
        for (std::size_t c = 0; c < 3; ++c)
            for (std::size_t k = 0; k < 3; ++k)
                P[r * m + place + c] += seconds * axes[3 * c + k] * P[r * m + speed + k];
    for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t c = 0; c < 3; ++c) {
            double dotted = 0.0;
            for (std::size_t k = 0; k < 3; ++k) dotted += axes[3 * r + k] * axes[3 * c + k];
            P[(place + r) * m + place + c] += dotted * seconds * (drift + wander * seconds * seconds / 3.0);
            const double across = axes[3 * r + c] * wander * seconds * seconds / 2.0;
            P[(place + r) * m + speed + c] += across;
            P[(speed + c) * m + place + r] += across;
            if (r == c) P[(speed + r) * m + speed + c] += wander * seconds;
        }
    const std::size_t spin = unknown::pose + 2;
    P[spin * m + spin] += twirl * seconds;
}

// Changes state and covariance in place; `off` (2n) becomes what was seen less what was expected. Returns the innovation in
// standard deviations, infinite where a point would lie behind the camera: nothing is changed then.
inline double filter_sighting(double *s, double *P, const double *hand, const double *points, const double *noise,
                              std::size_t n, double robust, double *off) {
    const std::size_t m = unknown::shape + 2 * n, rows = 2 * n;
    std::vector<double> H(rows * m), PH(m * rows), S(rows * rows), solved(rows), gain(m * rows), step(m);
    for (std::size_t i = 0; i < n; ++i) {
        const Seen one(s, hand, 0.0, i);
        double J[2][unknown::own];
        one.slopes(s, hand, 0.0, i, J);
        for (std::size_t r = 0; r < 2; ++r) {
            off[2 * i + r] = points[2 * i + r] - one.at[r];
            if (!std::isfinite(one.at[r])) return std::numeric_limits<double>::infinity();
            for (std::size_t c = 0; c < unknown::own; ++c) H[(2 * i + r) * m + column(c, i)] = J[r][c];
        }
    }
    for (std::size_t a = 0; a < m; ++a)
        for (std::size_t r = 0; r < rows; ++r) {
            double sum = 0.0;
            for (std::size_t c = 0; c < m; ++c) sum += P[a * m + c] * H[r * m + c];
            PH[a * rows + r] = sum;
        }
    for (std::size_t r = 0; r < rows; ++r)
        for (std::size_t q = 0; q < rows; ++q) {
            double sum = 0.0;
            for (std::size_t c = 0; c < m; ++c) sum += H[r * m + c] * PH[c * rows + q];
            S[r * rows + q] = sum;
        }
    const auto with_noise = [&](double times) {
        std::vector<double> out(S);
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t r = 0; r < 2; ++r)
                for (std::size_t c = 0; c < 2; ++c)
                    out[(2 * i + r) * rows + 2 * i + c] += times * noise[4 * i + 2 * r + c];
        return Factors(std::move(out), rows);
    };
    with_noise(1.0).solve(off, solved.data());
    double size = 0.0;
    for (std::size_t r = 0; r < rows; ++r) size += off[r] * solved[r];
    size = std::sqrt(size / double(rows));
    const double softened = 1.0 + (size / robust) * (size / robust);
    const Factors factors = with_noise(softened * softened);
    for (std::size_t a = 0; a < m; ++a) {
        factors.solve(&PH[a * rows], &gain[a * rows]);  // S is symmetric
        for (std::size_t r = 0; r < rows; ++r) step[a] += gain[a * rows + r] * off[r];
    }
    std::vector<double> from(s, s + state::points + 2 * n);
    stepped(from.data(), step.data(), n, s);
    for (std::size_t a = 0; a < m; ++a)
        for (std::size_t c = 0; c <= a; ++c) {
            double there = 0.0, back = 0.0;
            for (std::size_t r = 0; r < rows; ++r) {
                there += gain[a * rows + r] * PH[c * rows + r];
                back += gain[c * rows + r] * PH[a * rows + r];
            }
            const double mean = 0.5 * (P[a * m + c] - there + P[c * m + a] - back);
            P[a * m + c] = P[c * m + a] = mean;
        }
    return size;
}

}  // namespace grasptrack
