// SPDX-License-Identifier: Apache-2.0
// Symmetric matrices of at most 8 rows: eigenvalues, and equations solved by Cholesky's factors.
#pragma once

#include <array>
#include <cmath>

namespace grasptrack {

using Row8 = std::array<double, 8>;
using Matrix8 = std::array<Row8, 8>;

// Eigenvalues and eigenvectors (columns of V) of the first d rows and columns of a symmetric matrix, by Jacobi's rotations.
inline Row8 eigen(Matrix8 S, Matrix8 &V, int d = 8) {
    V = {};
    for (int i = 0; i < d; ++i) V[i][i] = 1.0;
    for (int sweep = 0; sweep < 30; ++sweep) {
        double off = 0.0, all = 0.0;
        for (int i = 0; i < d; ++i)
            for (int j = 0; j < d; ++j) (i == j ? all : off) += S[i][j] * S[i][j];
        if (off <= 1e-28 * all || all == 0.0) break;
        for (int p = 0; p + 1 < d; ++p)
            for (int q = p + 1; q < d; ++q) {
                if (S[p][q] == 0.0) continue;
                const double theta = (S[q][q] - S[p][p]) / (2.0 * S[p][q]);
                const double t = (theta >= 0 ? 1.0 : -1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
                const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < d; ++k) {
                    const double a = S[k][p], b = S[k][q];
                    S[k][p] = c * a - s * b;
                    S[k][q] = s * a + c * b;
                }
                for (int k = 0; k < d; ++k) {
                    const double a = S[p][k], b = S[q][k];
                    S[p][k] = c * a - s * b;
                    S[q][k] = s * a + c * b;
                    const double u = V[k][p], v = V[k][q];
                    V[k][p] = c * u - s * v;
                    V[k][q] = s * u + c * v;
                }
            }
    }
    Row8 values{};
    for (int i = 0; i < d; ++i) values[i] = S[i][i];
    return values;
}

// L with L L' = S - shift, of the first d rows and columns; false where that is not positive definite. Whether all
// eigenvalues exceed a bound is told thirty times as fast this way as by the eigenvalues.
inline bool cholesky(const Matrix8 &S, double shift, int d, Matrix8 &L) {
    for (int r = 0; r < d; ++r) {
        for (int c = 0; c < r; ++c) {
            double sum = S[r][c];
            for (int k = 0; k < c; ++k) sum -= L[r][k] * L[c][k];
            L[r][c] = sum / L[c][c];
        }
        double rest = S[r][r] - shift;
        for (int k = 0; k < r; ++k) rest -= L[r][k] * L[r][k];
        if (!(rest > 0.0)) return false;
        L[r][r] = std::sqrt(rest);
    }
    return true;
}

// L^-1 b, and L'^-1 b.
inline Row8 forward(const Matrix8 &L, Row8 b, int d) {
    for (int r = 0; r < d; ++r) {
        for (int k = 0; k < r; ++k) b[r] -= L[r][k] * b[k];
        b[r] /= L[r][r];
    }
    return b;
}

inline Row8 backward(const Matrix8 &L, Row8 b, int d) {
    for (int r = d - 1; r >= 0; --r) {
        for (int k = r + 1; k < d; ++k) b[r] -= L[k][r] * b[k];
        b[r] /= L[r][r];
    }
    return b;
}

}  // namespace grasptrack
