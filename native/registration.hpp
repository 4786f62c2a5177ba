// SPDX-License-Identifier: Apache-2.0
// One robust Gauss-Newton step of a registration. Defined in kernels/reference_evidence.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace grasptrack {

constexpr int kRounds = 3;
constexpr double kLeastNoise = 0.2;
constexpr double kSliding = 0.16;
constexpr double kSlight = 1e-6;

using Row8 = std::array<double, 8>;
using Matrix8 = std::array<Row8, 8>;

// Rows x and y of the displacement fields at one point.
inline void fields(double x, double y, Row8 &fx, Row8 &fy) {
    fx = {1.0, 0.0, x, -y, x, y, x * x, x * y};
    fy = {0.0, 1.0, y, x, -y, x, x * y, y * y};
}

// Eigenvalues and eigenvectors (columns of V) of a symmetric matrix by Jacobi's rotations.
inline Row8 eigen(Matrix8 S, Matrix8 &V) {
    V = {};
    for (int i = 0; i < 8; ++i) V[i][i] = 1.0;
    for (int sweep = 0; sweep < 30; ++sweep) {
        double off = 0.0, all = 0.0;
        for (int i = 0; i < 8; ++i)
            for (int j = 0; j < 8; ++j) (i == j ? all : off) += S[i][j] * S[i][j];
        if (off <= 1e-28 * all || all == 0.0) break;
        for (int p = 0; p < 7; ++p)
            for (int q = p + 1; q < 8; ++q) {
                if (S[p][q] == 0.0) continue;
                const double theta = (S[q][q] - S[p][p]) / (2.0 * S[p][q]);
                const double t = (theta >= 0 ? 1.0 : -1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
                const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 8; ++k) {
                    const double a = S[k][p], b = S[k][q];
                    S[k][p] = c * a - s * b;
                    S[k][q] = s * a + c * b;
                }
                for (int k = 0; k < 8; ++k) {
                    const double a = S[p][k], b = S[q][k];
                    S[p][k] = c * a - s * b;
                    S[q][k] = s * a + c * b;
                    const double u = V[k][p], v = V[k][q];
                    V[k][p] = c * u - s * v;
                    V[k][q] = s * u + c * v;
                }
            }
    }
    Row8 values;
    for (int i = 0; i < 8; ++i) values[i] = S[i][i];
    return values;
}

inline double lower_median(std::vector<double> values) {
    if (values.empty()) return 0.0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// Parameters of eight motions that each displace the points by 1 px rms, as columns.
inline Matrix8 whitening(const std::vector<Row8> &across, const std::vector<Row8> &along) {
    Matrix8 energy{}, own{}, V;
    for (std::size_t i = 0; i < across.size(); ++i)
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) energy[r][c] += across[i][r] * across[i][c] + along[i][r] * along[i][c];
    for (auto &row : energy)
        for (double &value : row) value /= static_cast<double>(across.size());
    const Row8 size = eigen(energy, V);
    const double least = kSlight * *std::max_element(size.begin(), size.end());
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c) own[r][c] = V[r][c] / std::sqrt(std::max(size[c], least));
    return own;
}

inline Row8 combined(const Row8 &row, const Matrix8 &own) {
    Row8 out{};
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c) out[c] += row[r] * own[r][c];
    return out;
}

// A'WA and A'Wb of weighted rows; gives the sum of the weights.
inline double normal_equations(const std::vector<Row8> &A, const std::vector<double> &weight, const double *offsets,
                               Matrix8 &N, Row8 &b) {
    double total = 0.0;
    for (std::size_t i = 0; i < A.size(); ++i) {
        total += weight[i];
        for (int r = 0; r < 8; ++r) {
            const double wa = weight[i] * A[i][r];
            b[r] += wa * offsets[i];
            for (int c = 0; c <= r; ++c) N[r][c] += wa * A[i][c];
        }
    }
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < r; ++c) N[c][r] = N[r][c];
    return total;
}

inline void projective_step(const double *points, const double *normals, const double *offsets, std::int64_t m,
                            const double *contacts, std::int64_t k, double radius, double loose, double *shift,
                            double *covariance) {
    double cx = 0.0, cy = 0.0;
    const double *centred = m > 0 ? points : contacts;
    const std::int64_t count = m > 0 ? m : k;
    for (std::int64_t i = 0; i < count; ++i) cx += centred[2 * i], cy += centred[2 * i + 1];
    cx /= static_cast<double>(count);
    cy /= static_cast<double>(count);

    std::vector<Row8> A(m), across(m), down(m);
    std::vector<double> weight(m, 1.0), residual(m);
    Row8 fx, fy;
    for (std::int64_t i = 0; i < m; ++i)
        fields((points[2 * i] - cx) / radius, (points[2 * i + 1] - cy) / radius, across[i], down[i]);
    Matrix8 own{};
    for (int i = 0; i < 8; ++i) own[i][i] = 1.0;
    if (m > 0) own = whitening(across, down);
    for (std::int64_t i = 0; i < m; ++i) {
        for (int j = 0; j < 8; ++j) A[i][j] = normals[2 * i] * across[i][j] + normals[2 * i + 1] * down[i][j];
        A[i] = combined(A[i], own);
        residual[i] = std::abs(offsets[i]);
    }
    double noise = std::max(1.4826 * lower_median(residual), kLeastNoise);
    Matrix8 C{};
    Row8 x{};
    auto solve = [&] {
        Matrix8 N{}, V;
        Row8 b{};
        const double total = normal_equations(A, weight, offsets, N, b);
        Row8 told = eigen(N, V);
        C = {};
        x = {};
        const double sliding = kSliding * kSliding * total;
        for (int e = 0; e < 8; ++e) {
            const double kept = std::max(told[e] - sliding, 0.0);
            const double variance = 1.0 / (kept / (noise * noise) + 1.0 / (loose * loose));
            const double share = kept / std::max(kept + sliding, 1e-300);
            double along = 0.0;
            for (int r = 0; r < 8; ++r) along += V[r][e] * b[r];
            for (int r = 0; r < 8; ++r) {
                x[r] += V[r][e] * variance * share * along / (noise * noise);
                for (int c = 0; c < 8; ++c) C[r][c] += V[r][e] * variance * V[c][e];
            }
        }
    };
    for (int round = 0; round < kRounds; ++round) {
        solve();
        if (round + 1 == kRounds) break;
        for (std::int64_t i = 0; i < m; ++i) {
            double expected = 0.0;
            for (int j = 0; j < 8; ++j) expected += A[i][j] * x[j];
            residual[i] = std::abs(offsets[i] - expected);
        }
        noise = std::max(1.4826 * lower_median(residual), kLeastNoise);
        for (std::int64_t i = 0; i < m; ++i)
            weight[i] = std::min(1.0, 2.0 * noise / std::max(residual[i], 1e-12));
    }
    for (std::int64_t i = 0; i < k; ++i) {
        fields((contacts[2 * i] - cx) / radius, (contacts[2 * i + 1] - cy) / radius, fx, fy);
        fx = combined(fx, own), fy = combined(fy, own);
        double c[4] = {0.0, 0.0, 0.0, 0.0}, sx = 0.0, sy = 0.0;
        for (int r = 0; r < 8; ++r) {
            sx += fx[r] * x[r];
            sy += fy[r] * x[r];
            for (int s = 0; s < 8; ++s) {
                c[0] += fx[r] * C[r][s] * fx[s];
                c[1] += fx[r] * C[r][s] * fy[s];
                c[2] += fy[r] * C[r][s] * fx[s];
                c[3] += fy[r] * C[r][s] * fy[s];
            }
        }
        shift[2 * i] = sx;
        shift[2 * i + 1] = sy;
        std::copy(c, c + 4, covariance + 4 * i);
    }
}

}  // namespace grasptrack
