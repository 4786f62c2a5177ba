// SPDX-License-Identifier: Apache-2.0
// Motions of an outline as least squares see them: the eight displacement fields of a homography near the identity, their
// normal equations, and which of them the outline shows. Defined in kernels/reference_evidence.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "scratch.hpp"
#include "symmetric.hpp"

namespace grasptrack {

constexpr double kSliding = 0.16;
constexpr double kSlight = 1e-6;

// Rows x and y of the displacement fields at one point.
inline void fields(double x, double y, Row8 &fx, Row8 &fy) {
    fx = {1.0, 0.0, x, -y, x, y, x * x, x * y};
    fy = {0.0, 1.0, y, x, -y, x, x * y, y * y};
}

// The normal equations of n offsets along normals in d of the fields, in parameters of d motions that each displace the
// points by 1 px rms. Rows are kept column by column, and weights beside them, padded by one that counts nothing.
class Motions {
  public:
    Motions(std::size_t n, int d) : d(d), n_(n), padded_(n + n % 2), values_(padded_ * (kColumns + 1)), energy_{} {
        for (int c = 0; n > 0 && c <= kColumns; ++c) values_[c * padded_ + padded_ - 1] = 0.0;
    }

    const int d;

    // Point i, relative to the points' centre in radii; its normal; and its offset in px.
    void set(std::size_t i, double x, double y, double nx, double ny, double offset) {
        double *at = values_.get() + i;
        const double along = nx * x + ny * y;
        const double row[8] = {nx, ny, along, ny * x - nx * y, nx * x - ny * y, nx * y + ny * x, along * x, along * y};
        for (int c = 0; c < d; ++c) at[c * padded_] = row[c];
        at[kOffset * padded_] = offset;
        at[kWeight * padded_] = 1.0;
        const double xx = x * x, xy = x * y, yy = y * y;
        const double moments[kMoments] = {x,      y,      xx,      xy,      yy,      xx * x,  xx * y,
                                          yy * x, yy * y, xx * xx, xx * xy, xy * xy, xy * yy, yy * yy};
        for (int k = 0; k < kMoments; ++k) energy_[k] += moments[k];
    }

    void set_offset(std::size_t i, double offset) { values_[kOffset * padded_ + i] = offset; }

    // To be called when all points are set.
    void whiten() {
        Matrix8 E{}, V, L;
        double trace = 0.0;
        own = {};
        if (n_ == 0) {
            for (int i = 0; i < d; ++i) own[i][i] = 1.0;
            return;
        }
        energy(E);
        for (int i = 0; i < d; ++i) trace += E[i][i];
        if (cholesky(E, kSlight * trace, d, L) && cholesky(E, 0.0, d, L)) {  // none is bounded
            for (int c = 0; c < d; ++c) {
                Row8 unit{};
                unit[c] = 1.0;
                const Row8 column = backward(L, unit, d);
                for (int r = 0; r < d; ++r) own[r][c] = column[r];
            }
        } else {
            const Row8 size = eigen(E, V, d);
            const double least = kSlight * *std::max_element(size.begin(), size.begin() + d);
            for (int r = 0; r < d; ++r)
                for (int c = 0; c < d; ++c) own[r][c] = V[r][c] / std::sqrt(std::max(size[c], least));
        }
    }

    double *weights() { return values_.get() + kWeight * padded_; }
    const double *offsets() const { return values_.get() + kOffset * padded_; }

    // A'WA and A'Wb in the whitened parameters; gives the sum of the weights.
    double normal_equations(Matrix8 &N, Row8 &b) const {
        Matrix8 M{};
        Row8 g{};
        double *weighted = values_.get() + kColumns * padded_;
        const double *weight = values_.get() + kWeight * padded_;
        const double total = sum(weight);
        for (int r = 0; r < d; ++r) {
            const double *row = values_.get() + r * padded_;
            for (std::size_t i = 0; i < padded_; ++i) weighted[i] = weight[i] * row[i];
            g[r] = product(weighted, offsets());
            for (int c = 0; c <= r; ++c) M[r][c] = M[c][r] = product(weighted, values_.get() + c * padded_);
        }
        Matrix8 half{};
        for (int r = 0; r < d; ++r)
            for (int k = 0; k < d; ++k)
                for (int c = 0; c < d; ++c) half[r][c] += M[r][k] * own[k][c];
        N = {};
        b = {};
        for (int k = 0; k < d; ++k)
            for (int r = 0; r < d; ++r) {
                b[r] += own[k][r] * g[k];
                for (int c = 0; c < d; ++c) N[r][c] += own[k][r] * half[k][c];
            }
        return total;
    }

    // From whitened parameters to those of the fields.
    Row8 parameters(const Row8 &y) const {
        Row8 x{};
        for (int r = 0; r < d; ++r)
            for (int c = 0; c < d; ++c) x[r] += own[r][c] * y[c];
        return x;
    }

    // From their covariance to that of the fields'.
    Matrix8 parameters(const Matrix8 &C) const {
        Matrix8 half{}, out{};
        for (int r = 0; r < d; ++r)
            for (int k = 0; k < d; ++k)
                for (int c = 0; c < d; ++c) half[r][c] += own[r][k] * C[k][c];
        for (int r = 0; r < d; ++r)
            for (int c = 0; c < d; ++c)
                for (int k = 0; k < d; ++k) out[r][c] += half[r][k] * own[c][k];
        return out;
    }

    // What the motion with these parameters of the fields leaves of each offset.
    void residuals(const Row8 &x, double *out) const {
        for (std::size_t i = 0; i < n_; ++i) out[i] = offsets()[i];
        for (int c = 0; c < d; ++c) {
            const double *column = values_.get() + c * padded_;
            for (std::size_t i = 0; i < n_; ++i) out[i] -= column[i] * x[c];
        }
    }

    Matrix8 own{};  // parameters of the whitened motions, as columns

  private:
    static constexpr int kOffset = 8, kWeight = 9, kColumns = 10, kMoments = 14;

    void energy(Matrix8 &E) const {
        double m[kMoments];
        const double count = static_cast<double>(n_);
        for (int k = 0; k < kMoments; ++k) m[k] = energy_[k] / count;
        const double x = m[0], y = m[1], xx = m[2], xy = m[3], yy = m[4], xxx = m[5], xxy = m[6], xyy = m[7], yyy = m[8];
        const double round = xx + yy, stretched = xx - yy;
        const double upper[8][8] = {
            {1, 0, x, -y, x, y, xx, xy},
            {0, 1, y, x, -y, x, xy, yy},
            {0, 0, round, 0, stretched, 2 * xy, xxx + xyy, xxy + yyy},
            {0, 0, 0, round, -2 * xy, stretched, 0, 0},
            {0, 0, 0, 0, round, 0, xxx - xyy, xxy - yyy},
            {0, 0, 0, 0, 0, round, 2 * xxy, 2 * xyy},
            {0, 0, 0, 0, 0, 0, m[9] + m[11], m[10] + m[12]},
            {0, 0, 0, 0, 0, 0, 0, m[11] + m[13]},
        };
        for (int r = 0; r < 8; ++r)
            for (int c = r; c < 8; ++c) E[r][c] = E[c][r] = upper[r][c];
    }

    double sum(const double *a) const {
        double lane[4] = {};
        std::size_t i = 0;
        for (; i + 4 <= padded_; i += 4)
            for (int k = 0; k < 4; ++k) lane[k] += a[i + k];
        for (; i < padded_; ++i) lane[i % 2] += a[i];
        return (lane[0] + lane[1]) + (lane[2] + lane[3]);
    }

    double product(const double *a, const double *b) const {
        double lane[4] = {};
        std::size_t i = 0;
        for (; i + 4 <= padded_; i += 4)
            for (int k = 0; k < 4; ++k) lane[k] += a[i + k] * b[i + k];
        for (; i < padded_; ++i) lane[i % 2] += a[i] * b[i];
        return (lane[0] + lane[1]) + (lane[2] + lane[3]);
    }

    std::size_t n_, padded_;
    Scratch<double> values_;
    double energy_[kMoments];
};

}  // namespace grasptrack
