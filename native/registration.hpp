// SPDX-License-Identifier: Apache-2.0
// One robust Gauss-Newton step of a registration. Defined in kernels/reference_evidence.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "motions.hpp"

namespace grasptrack {

constexpr int kRounds = 3;
constexpr double kLeastNoise = 0.2;

// Disorders the values.
inline double lower_median_in_place(std::vector<double> &values) {
    if (values.empty()) return 0.0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

inline double lower_median(std::vector<double> values) { return lower_median_in_place(values); }

// The parameters of whitened motions and their covariance, given the noise of the offsets and how loose the motions are
// before any is looked at. What slides along the outline, below `sliding`, stays as loose as it was.
struct Loosely {
    explicit Loosely(double loose) : loose(loose) {}

    void solve(const Matrix8 &N, const Row8 &b, double sliding, double noise, bool spread) {
        const double sure = 1.0 / (noise * noise), prior = 1.0 / (loose * loose);
        Matrix8 seen, L;
        if (cholesky(N, sliding, 8, L) && cholesky(N, 0.0, 8, L)) {  // every motion is told: all eigenvalues exceed it
            const Row8 y = backward(L, forward(L, b, 8), 8);
            Row8 told{};
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) {
                    const double kept = N[r][c] - (r == c ? sliding : 0.0);
                    told[r] += kept * y[c] * sure;
                    seen[r][c] = kept * sure + (r == c ? prior : 0.0);
                }
            cholesky(seen, 0.0, 8, L);
            x = backward(L, forward(L, told, 8), 8);
            if (!spread) return;
            for (int c = 0; c < 8; ++c) {
                Row8 unit{};
                unit[c] = 1.0;
                C[c] = backward(L, forward(L, unit, 8), 8);
            }
            return;
        }
        Matrix8 V;
        const Row8 told = eigen(N, V);
        C = {};
        x = {};
        for (int e = 0; e < 8; ++e) {
            const double kept = std::max(told[e] - sliding, 0.0), variance = 1.0 / (kept * sure + prior);
            const double share = kept / std::max(kept + sliding, 1e-300);
            double along = 0.0;
            for (int r = 0; r < 8; ++r) along += V[r][e] * b[r];
            for (int r = 0; r < 8; ++r) {
                x[r] += V[r][e] * variance * share * along * sure;
                for (int c = 0; c < 8; ++c) C[r][c] += V[r][e] * variance * V[c][e];
            }
        }
    }

    const double loose;
    Row8 x{};
    Matrix8 C{};
};

inline void projective_step(const double *points, const double *normals, const double *offsets, std::int64_t m,
                            const double *contacts, std::int64_t k, double radius, double loose, double *shift,
                            double *covariance) {
    double cx = 0.0, cy = 0.0;
    const double *centred = m > 0 ? points : contacts;
    const std::int64_t count = m > 0 ? m : k;
    for (std::int64_t i = 0; i < count; ++i) cx += centred[2 * i], cy += centred[2 * i + 1];
    cx /= static_cast<double>(count);
    cy /= static_cast<double>(count);

    const auto n = static_cast<std::size_t>(m);
    Motions motions(n, 8);
    std::vector<double> residual(n), size(n);
    for (std::size_t i = 0; i < n; ++i) {
        motions.set(i, (points[2 * i] - cx) / radius, (points[2 * i + 1] - cy) / radius, normals[2 * i],
                    normals[2 * i + 1], offsets[i]);
        size[i] = std::abs(offsets[i]);
    }
    motions.whiten();
    double noise = std::max(1.4826 * lower_median_in_place(size), kLeastNoise);
    Loosely solved(loose);
    for (int round = 0; round < kRounds; ++round) {
        Matrix8 N;
        Row8 b;
        const double total = motions.normal_equations(N, b);
        solved.solve(N, b, kSliding * kSliding * total, noise, round + 1 == kRounds);
        if (round + 1 == kRounds) break;
        motions.residuals(motions.parameters(solved.x), residual.data());
        for (std::size_t i = 0; i < n; ++i) size[i] = residual[i] = std::abs(residual[i]);
        noise = std::max(1.4826 * lower_median_in_place(size), kLeastNoise);
        double *weight = motions.weights();
        for (std::size_t i = 0; i < n; ++i) weight[i] = std::min(1.0, 2.0 * noise / std::max(residual[i], 1e-12));
    }
    const Row8 x = motions.parameters(solved.x);
    const Matrix8 C = motions.parameters(solved.C);
    for (std::int64_t i = 0; i < k; ++i) {
        Row8 fx, fy, cfx{}, cfy{};
        fields((contacts[2 * i] - cx) / radius, (contacts[2 * i + 1] - cy) / radius, fx, fy);
        double sx = 0.0, sy = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
        for (int r = 0; r < 8; ++r) {
            sx += fx[r] * x[r];
            sy += fy[r] * x[r];
            for (int s = 0; s < 8; ++s) cfx[r] += C[r][s] * fx[s], cfy[r] += C[r][s] * fy[s];
        }
        for (int r = 0; r < 8; ++r) xx += fx[r] * cfx[r], xy += fx[r] * cfy[r], yy += fy[r] * cfy[r];
        const double c[4] = {xx, xy, xy, yy};
        shift[2 * i] = sx;
        shift[2 * i + 1] = sy;
        std::copy(c, c + 4, covariance + 4 * i);
    }
}

}  // namespace grasptrack
