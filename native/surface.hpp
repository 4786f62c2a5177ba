// SPDX-License-Identifier: Apache-2.0
// What the grey levels of a surface say of a small motion. Defined in kernels/reference_fusion.py.
#pragma once

#include "edges.hpp"
#include "light.hpp"
#include "register.hpp"

namespace grasptrack {

constexpr double kLeastNoiseGrey = 0.7;
constexpr std::size_t kFewest = 24;
constexpr double kChance = 3.0;
constexpr double kLeastReal = 0.4;
constexpr double kEdge = 2.0;
constexpr double kBesideHidden = 3.0;

struct Equations {
    Matrix8 N{}, told{}, chance{};
    Row8 b{};
    double total = 0.0, share = 0.0, noise = 0.0, correlation = 0.0;
};

struct SurfaceSamples {
    const Vec *places, *slopes;
    const double *values;
    std::size_t count;
};

// B' M B.
inline Matrix8 in_basis(const Matrix8 &M, const Matrix8 &B) {
    Matrix8 half{}, out{};
    for (int r = 0; r < 8; ++r)
        for (int k = 0; k < 8; ++k)
            for (int c = 0; c < 8; ++c) half[r][c] += M[r][k] * B[k][c];
    for (int k = 0; k < 8; ++k)
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) out[r][c] += B[k][r] * half[k][c];
    return out;
}

// Room is kept from surface to surface.
class SurfaceFit {
  public:
    SurfaceFit(const Image<std::uint8_t> &coarse, double shrink, const Clear &clear, std::size_t most)
        : coarse_(coarse), clear_(clear), shrink_(shrink), columns_(kAll, most) {}

    void add(const double *H, Vec centre, double radius, const Matrix8 &basis, const SurfaceSamples &samples,
             Equations &out) {
        if (!look(H, centre, radius, samples)) return;
        double *seen = columns_[kSeen], *wanted = columns_[kWanted], *rest = columns_[kRest], *size = columns_[kSize];
        double mean = 0.0;
        for (std::size_t i = 0; i < n_; ++i) mean += wanted[i];
        mean /= static_cast<double>(n_);
        for (std::size_t i = 0; i < n_; ++i) rest[i] = seen[i] - wanted[i], wanted[i] -= mean;
        const double middle = select_(rest, n_, (n_ - 1) / 2);  // so that what covers it does not bend the light
        for (std::size_t i = 0; i < n_; ++i) rest[i] -= middle;
        const LightFit fit = fit_light(wanted, columns_[kX], columns_[kY], seen, n_, kLeastNoiseGrey, rest,
                                       columns_[kWeight], size, select_);
        if (!fit.independent) return;
        equations(fit, basis, out);
        out.total = fit.total;
        out.share = out.total / static_cast<double>(n_);
        out.noise = fit.noise;
        out.correlation = correlation(fit);
    }

  private:
    // Of slopes, their mean in both images and half their difference.
    enum { kSeen, kWanted, kX, kY, kRest, kWeight, kSize, kMeanX, kMeanY, kHalfX, kHalfY, kAll };

    bool look(const double *H, Vec centre, double radius, const SurfaceSamples &samples) {
        double h[9];
        for (int i = 0; i < 9; ++i) h[i] = H[i] / H[8];
        const double right = static_cast<double>(coarse_.width) - 1 - kEdge;
        const double bottom = static_cast<double>(coarse_.height) - 1 - kEdge;
        const double by = 1.0 / shrink_, slope_by = 0.5 / shrink_, unit = 1.0 / radius;
        const std::ptrdiff_t down = coarse_.width;
        double *seen = columns_[kSeen], *wanted = columns_[kWanted], *x = columns_[kX], *y = columns_[kY];
        double *now_x = columns_[kMeanX], *now_y = columns_[kMeanY], *then_x = columns_[kHalfX], *then_y = columns_[kHalfY];
        std::size_t n = 0;
        for (std::size_t i = 0; i < samples.count; ++i) {
            const Vec p = samples.places[i], s = samples.slopes[i];
            const double w = h[6] * p.x + h[7] * p.y + 1.0;
            if (!(w > 1e-9)) continue;
            const double over = 1.0 / w;
            const Vec u{(h[0] * p.x + h[1] * p.y + h[2]) * over, (h[3] * p.x + h[4] * p.y + h[5]) * over};
            const Vec v{(u.x + 0.5) * by - 0.5, (u.y + 0.5) * by - 0.5};
            if (!(v.x >= kEdge && v.y >= kEdge && v.x < right && v.y < bottom)) continue;
            if (hidden_at(clear_, u, kBesideHidden * shrink_)) continue;
            const double a = h[0] - h[6] * u.x, b = h[1] - h[7] * u.x, c = h[3] - h[6] * u.y, d = h[4] - h[7] * u.y;
            const double determinant = w / (a * d - b * c);  // a to d still times w
            then_x[n] = (d * s.x - c * s.y) * determinant;
            then_y[n] = (a * s.y - b * s.x) * determinant;
            const auto column = static_cast<std::int32_t>(v.x), row = static_cast<std::int32_t>(v.y);
            const double fx = v.x - column, fy = v.y - row;
            const std::uint8_t *q = coarse_.data + row * down + column;
            const auto between = [fx, fy](int a, int b, int c, int d) {
                const double top = a + fx * (b - a), low = c + fx * (d - c);
                return top + fy * (low - top);
            };
            const int q00 = q[0], q01 = q[1], q10 = q[down], q11 = q[down + 1];
            seen[n] = between(q00, q01, q10, q11);
            now_x[n] = slope_by * between(q01 - q[-1], q[2] - q00, q11 - q[down - 1], q[down + 2] - q10);
            now_y[n] = slope_by * between(q10 - q[-down], q11 - q[1 - down], q[2 * down] - q00, q[2 * down + 1] - q01);
            wanted[n] = samples.values[i];
            x[n] = (u.x - centre.x) * unit, y[n] = (u.y - centre.y) * unit;
            ++n;
        }
        n_ = n;
        return n >= kFewest;
    }

    void equations(const LightFit &fit, const Matrix8 &basis, Equations &out) {
        const std::size_t padded = n_ + n_ % 2;
        const double gain = fit.light[0];
        double *mean_x = columns_[kMeanX], *mean_y = columns_[kMeanY], *half_x = columns_[kHalfX], *half_y = columns_[kHalfY];
        if (n_ % 2) mean_x[n_] = mean_y[n_] = half_x[n_] = half_y[n_] = 0.0;
        for (std::size_t i = 0; i < padded; ++i) {
            const double ax = mean_x[i], ay = mean_y[i], bx = gain * half_x[i], by = gain * half_y[i];
            mean_x[i] = 0.5 * (ax + bx), mean_y[i] = 0.5 * (ay + by);
            half_x[i] = 0.5 * (ax - bx), half_y[i] = 0.5 * (ay - by);
        }
        // now' then + then' now = 2 (mean' mean - half' half): two sums of squares
        Row8 product{};
        const Matrix8 energy = squares(fit, mean_x, mean_y, &product), differing = squares(fit, half_x, half_y, nullptr);
        Matrix8 raw;
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) raw[r][c] = energy[r][c] - differing[r][c];
        out.N = in_basis(energy, basis);
        out.told = in_basis(raw, basis);
        out.chance = out.N;
        const double by = kChance / std::sqrt(std::max(fit.total, 1.0));
        double real = 0.0, all = 0.0;
        for (int i = 0; i < 8; ++i) real += out.told[i][i], all += out.N[i][i];
        const double share = std::min(std::max(real / (all + 1e-300), kLeastReal), 1.0);
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) {
                out.chance[r][c] *= by;
                out.N[r][c] *= share;
                out.b[c] -= product[r] * basis[r][c];
            }
    }

    // A'WA of the motions by which slopes see the places move, without what the light explains of them; and A'W rest.
    Matrix8 squares(const LightFit &fit, const double *slope_x, const double *slope_y, Row8 *product) const {
        const double *weight = columns_[kWeight], *rest = columns_[kRest], *wanted = columns_[kWanted];
        const double *x = columns_[kX], *y = columns_[kY];
        constexpr int sums = 36 + 24 + 8;
        Pair total[sums], by_wanted[8];
        for (Pair &sum : total) sum = both(0.0);
        for (Pair &sum : by_wanted) sum = both(0.0);
        for (std::size_t i = 0; i < n_; i += 2) {
            const Pair u = load(x + i), v = load(y + i), sx = load(slope_x + i), sy = load(slope_y + i);
            const Pair w = load(weight + i), left = load(rest + i), c = load(wanted + i);
            const Pair p = sx * u + sy * v;
            const Pair J[8] = {sx, sy, p, sy * u - sx * v, sx * u - sy * v, sx * v + sy * u, p * u, p * v};
            int k = 0;
            for (int r = 0; r < 8; ++r) {
                const Pair wj = w * J[r];
                for (int s = 0; s <= r; ++s, ++k) total[k] = total[k] + wj * J[s];
                by_wanted[r] = by_wanted[r] + wj * c;
                total[36 + r] = total[36 + r] + wj;
                total[44 + r] = total[44 + r] + wj * u;
                total[52 + r] = total[52 + r] + wj * v;
                total[60 + r] = total[60 + r] + wj * left;
            }
        }
        const auto sum = [](const Pair &value) { return value[0] + value[1]; };
        Matrix8 out;
        std::array<Row8, 4> by, explained{};
        for (int r = 0, k = 0; r < 8; ++r) {
            for (int s = 0; s <= r; ++s, ++k) out[r][s] = out[s][r] = sum(total[k]);
            by[0][r] = sum(by_wanted[r]);
            for (int j = 0; j < 3; ++j) by[1 + j][r] = sum(total[36 + 8 * j + r]);
            if (product) (*product)[r] = sum(total[60 + r]);
        }
        for (int r = 0; r < 4; ++r)
            for (int c = 0; c < 4; ++c)
                for (int j = 0; j < 8; ++j) explained[r][j] += fit.inverse[r][c] * by[c][j];
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c)
                for (int j = 0; j < 4; ++j) out[r][c] -= by[j][r] * explained[j][c];
        return out;
    }

    // Of what is seen and what is wanted, without the levels that change linearly: what these leave of the sums.
    static double correlation(const LightFit &fit) {
        double Q[3][3], q[3][2];
        for (int r = 0; r < 3; ++r) {
            q[r][0] = fit.q[r + 1], q[r][1] = fit.Q[r + 1][0];
            for (int c = 0; c < 3; ++c) Q[r][c] = fit.Q[r + 1][c + 1];
        }
        double aa = fit.squares, bb = fit.Q[0][0], ab = fit.q[0];
        for (int p = 0; p < 3; ++p) {
            const double pivot = Q[p][p];
            aa -= q[p][0] * q[p][0] / pivot, bb -= q[p][1] * q[p][1] / pivot, ab -= q[p][0] * q[p][1] / pivot;
            for (int r = p + 1; r < 3; ++r) {
                const double by = Q[r][p] / pivot;
                for (int c = p; c < 3; ++c) Q[r][c] -= by * Q[p][c];
                q[r][0] -= by * q[p][0], q[r][1] -= by * q[p][1];
            }
        }
        return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
    }

    Image<std::uint8_t> coarse_;
    Clear clear_;
    double shrink_;
    std::size_t n_ = 0;
    Columns columns_;
    Selection select_;
};

}  // namespace grasptrack
