// SPDX-License-Identifier: Apache-2.0
// What edges tell of the pose beyond what noise in their normals seems to tell. The NumPy definition is beyond_noise in
// grasptrack.kernels.reference_pose_system.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "matrix.hpp"

namespace grasptrack::pose {

// Eigenvalues of a symmetric matrix and its eigenvectors as columns, by Jacobi's rotations.
template <std::size_t N> std::pair<Vector<N>, Matrix<N>> eigen(Matrix<N> a) {
    Matrix<N> vectors = diagonal<N>(1.0);
    constexpr int sweeps = 30;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        double off = 0, on = 0;
        for (std::size_t i = 0; i < N; ++i)
            for (std::size_t j = 0; j < N; ++j) (i == j ? on : off) += a[i * N + j] * a[i * N + j];
        if (!(off > 1e-30 * on)) break;
        for (std::size_t p = 0; p < N; ++p)
            for (std::size_t q = p + 1; q < N; ++q) {
                if (a[p * N + q] == 0.0) continue;
                const double theta = (a[q * N + q] - a[p * N + p]) / (2 * a[p * N + q]);
                const double t = (theta < 0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1));
                const double c = 1 / std::sqrt(t * t + 1), s = t * c;
                for (std::size_t k = 0; k < N; ++k) {
                    const double x = a[k * N + p], y = a[k * N + q];
                    a[k * N + p] = c * x - s * y;
                    a[k * N + q] = s * x + c * y;
                }
                for (std::size_t k = 0; k < N; ++k) {
                    const double x = a[p * N + k], y = a[q * N + k];
                    a[p * N + k] = c * x - s * y;
                    a[q * N + k] = s * x + c * y;
                    const double u = vectors[k * N + p], v = vectors[k * N + q];
                    vectors[k * N + p] = c * u - s * v;
                    vectors[k * N + q] = s * u + c * v;
                }
            }
    }
    Vector<N> values;
    for (std::size_t i = 0; i < N; ++i) values[i] = a[i * N + i];
    return {values, vectors};
}

// By which rows of the edges are to be multiplied from the right, transposed. Along a motion under which the outline stays on
// itself, as a disc turned, exact normals tell nothing; noise in them seems to tell all the same.
//
// own: the edges' information, of the pose and of the thickness. along: the same of motions along the outline, packed.
// noise: rad^2, variance of the normals' directions.
inline Matrix<9> beyond_noise(const Matrix<9> &own, const Packed<8> &along, double noise) {
    constexpr std::size_t N = 8;
    Matrix<9> out = diagonal<9>(1.0);
    if (!(noise > 0)) return out;
    for (double value : own)
        if (!std::isfinite(value)) return out;
    Packed<N> by_noise = along;
    for (double &value : by_noise) value *= noise;
    Matrix<N> L, inverse;
    if (!cholesky<N>(unpacked<N>(by_noise), L, inverse)) return out;
    Matrix<N> lead;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) lead[i * N + j] = own[i * 9 + j];
    const auto [values, Q] = eigen<N>(times<N>(times<N>(inverse, lead), transposed<N>(inverse)));
    Matrix<N> scaled = transposed<N>(Q);
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) scaled[i * N + j] *= std::max(0.0, 1 - 1 / std::max(values[i], 1e-12));
    const Matrix<N> telling = times<N>(times<N>(times<N>(L, Q), scaled), inverse);
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) out[i * 9 + j] = telling[i * N + j];
    return out;
}

}  // namespace grasptrack::pose
