// SPDX-License-Identifier: Apache-2.0
// The light in which places are seen: a gain on the grey levels that are wanted there, and levels that change linearly.
// Found in Tukey's biweight, so that what covers some of the places does not bend it. Defined in kernels/reference_fusion.py.
#pragma once

#include <array>
#include <cmath>
#include <cstring>

#include "register.hpp"
#include "selection.hpp"

namespace grasptrack {

constexpr double kQuietSigma = 0.430727;
constexpr int kLightWeighings = 4;

using Row4 = std::array<double, 4>;
using Matrix4 = std::array<Row4, 4>;

// The inverse of a symmetric positive 4 x 4 matrix; false where its rows are not independent.
inline bool inverted(const Matrix4 &Q, Matrix4 &out) {
    Row4 size;
    for (int i = 0; i < 4; ++i) {
        if (!(Q[i][i] > 0.0)) return false;
        size[i] = std::sqrt(Q[i][i]);
    }
    double a[4][8] = {}, determinant = 1.0;
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) a[r][c] = Q[r][c] / (size[r] * size[c]);
        a[r][4 + r] = 1.0;
    }
    for (int p = 0; p < 4; ++p) {  // of a correlation matrix the pivots need no exchange
        determinant *= a[p][p];
        if (!(determinant > 1e-9)) return false;
        const double pivot = a[p][p];
        for (double &value : a[p]) value /= pivot;
        for (int r = 0; r < 4; ++r) {
            if (r == p) continue;
            const double by = a[r][p];
            for (int c = 0; c < 8; ++c) a[r][c] -= by * a[p][c];
        }
    }
    for (int r = 0; r < 4; ++r)
        for (int c = 0; c < 4; ++c) out[r][c] = a[r][4 + c] / (size[r] * size[c]);
    return true;
}

// Tukey's weight at residual / noise, `by` being 1 / (kTukey noise).
inline double tukey_weight(double residual, double by) {
    const double u = residual * by, rest = std::max(1.0 - u * u, 0.0);
    return rest * rest;
}

// Columns of numbers of as many places, padded by one more where that makes pairs of them.
class Columns {
  public:
    Columns(std::size_t columns, std::size_t most) : stride_(most + most % 2 + 2), values_(columns * stride_) {}
    double *operator[](std::size_t column) { return values_.data() + column * stride_; }
    const double *operator[](std::size_t column) const { return values_.data() + column * stride_; }

  private:
    std::size_t stride_;
    std::vector<double> values_;
};

inline Pair load(const double *at) {
    Pair out;
    std::memcpy(&out, at, sizeof out);
    return out;
}

struct LightFit {
    double noise = 0.0, total = 0.0;
    bool independent = false;  // else of one grey level: there is no gain to find
    Row4 light{};
    Matrix4 Q{}, inverse{};
    Row4 q{};           // products with what is seen
    double squares = 0.0;  // of what is seen
};

// Sums of weighted products of the four columns (wanted, 1, x, y) with each other and with what is seen; n is even.
inline void light_sums(const double *weight, const double *wanted, const double *x, const double *y, const double *seen,
                       std::size_t n, LightFit &out) {
    Pair sums[15];
    for (Pair &sum : sums) sum = both(0.0);
    for (std::size_t i = 0; i < n; i += 2) {
        const Pair w = load(weight + i), c = load(wanted + i), u = load(x + i), v = load(y + i), s = load(seen + i);
        const Pair wc = w * c, wu = w * u, wv = w * v, ws = w * s;
        sums[0] = sums[0] + wc * c, sums[1] = sums[1] + wc, sums[2] = sums[2] + wc * u, sums[3] = sums[3] + wc * v;
        sums[4] = sums[4] + w, sums[5] = sums[5] + wu, sums[6] = sums[6] + wv;
        sums[7] = sums[7] + wu * u, sums[8] = sums[8] + wu * v, sums[9] = sums[9] + wv * v;
        sums[10] = sums[10] + wc * s, sums[11] = sums[11] + ws, sums[12] = sums[12] + wu * s, sums[13] = sums[13] + wv * s;
        sums[14] = sums[14] + ws * s;
    }
    double total[15];
    for (int k = 0; k < 15; ++k) total[k] = sums[k][0] + sums[k][1];
    constexpr int place[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};
    for (int r = 0; r < 4; ++r) {
        out.q[r] = total[10 + r];
        for (int c = 0; c < 4; ++c) out.Q[r][c] = total[place[r][c]];
    }
    out.total = total[4];
    out.squares = total[14];
}

// `rest` is what the light leaves of `seen`: at first by a guess, then as fitted. Where the columns are not independent,
// that of the round before stays. The columns have room for n + n % 2 values.
inline LightFit fit_light(double *wanted, double *x, double *y, double *seen, std::size_t n, double least_noise,
                          double *rest, double *weight, double *size, Selection &select) {
    LightFit out;
    const std::size_t padded = n + n % 2;
    for (double *column : {wanted, x, y, seen, rest}) column[padded - 1] = n % 2 ? 0.0 : column[padded - 1];
    for (int round = 0; round < kLightWeighings; ++round) {
        for (std::size_t i = 0; i < n; ++i) size[i] = std::fabs(rest[i]);
        const std::size_t third = (n - 1) / 3;
        const double quiet = round == 0 ? select(size, n, third) : select.near(size, n, third, out.noise * kQuietSigma);
        out.noise = std::max(quiet / kQuietSigma, least_noise);
        const double by = 1.0 / (kTukey * out.noise);
        for (std::size_t i = 0; i < padded; ++i) weight[i] = tukey_weight(rest[i], by);
        if (n % 2) weight[n] = 0.0;
        light_sums(weight, wanted, x, y, seen, padded, out);
        out.independent = inverted(out.Q, out.inverse);
        if (!out.independent) return out;
        for (int r = 0; r < 4; ++r) {
            out.light[r] = 0.0;
            for (int c = 0; c < 4; ++c) out.light[r] += out.inverse[r][c] * out.q[c];
        }
        const Row4 l = out.light;
        for (std::size_t i = 0; i < padded; ++i)
            rest[i] = seen[i] - l[0] * wanted[i] - l[1] - l[2] * x[i] - l[3] * y[i];
        if (n % 2) rest[n] = 0.0;
    }
    return out;
}

}  // namespace grasptrack
