// SPDX-License-Identifier: Apache-2.0
// The homography that lays an outline on the edges of an image. Defined in kernels/reference_registration.py.
#pragma once

#include "edges.hpp"
#include "evidence.hpp"
#include "outline.hpp"
#include "registration.hpp"

namespace grasptrack {

constexpr int kWeighings = 4;
constexpr double kTukey = 4.685;
constexpr double kLeastNoisePx = 0.03;
constexpr std::size_t kEnough = 12;

struct Registered {
    double H[9];
    double noise = std::numeric_limits<double>::quiet_NaN();
    bool good = false;
};

// The whitened motion that leaves least; none of what slides along the outline.
inline Row8 told_motion(const Motions &motions) {
    Matrix8 N, L, V;
    Row8 b, y{};
    const int d = motions.d;
    const double least = kSliding * kSliding * motions.normal_equations(N, b);
    if (cholesky(N, least, d, L) && cholesky(N, 0.0, d, L)) return backward(L, forward(L, b, d), d);
    const Row8 told = eigen(N, V, d);
    for (int e = 0; e < d; ++e) {
        if (!(told[e] > least)) continue;
        double along = 0.0;
        for (int r = 0; r < d; ++r) along += V[r][e] * b[r];
        for (int r = 0; r < d; ++r) y[r] += V[r][e] * along / told[e];
    }
    return y;
}

// The motion that the points move by, in Tukey's biweight: its parameters in px. Leaves residuals, and weights in `motions`.
inline Row8 robust_motion(Motions &motions, std::vector<double> &residual, std::vector<double> &size, double &noise) {
    Row8 x{};
    motions.whiten();
    double *weight = motions.weights();
    for (int round = 0; round < kWeighings; ++round) {
        x = motions.parameters(told_motion(motions));
        motions.residuals(x, residual.data());
        for (std::size_t i = 0; i < residual.size(); ++i) size[i] = std::fabs(residual[i]);
        noise = std::max(1.4826 * lower_median_in_place(size), kLeastNoisePx);
        const double scale = kTukey * noise;
        for (std::size_t i = 0; i < residual.size(); ++i) {
            const double u = residual[i] / scale, rest = 1.0 - u * u;
            weight[i] = std::fabs(u) < 1.0 ? rest * rest : 0.0;
        }
    }
    return x;
}

// H moved by the homography near the identity with these parameters, in radii; whether its last element is not 0.
inline bool move(double *H, const Row8 &x, Vec centre, double radius) {
    const double M[3][3] = {{1.0 + x[2] + x[4], x[5] - x[3], x[0]},
                            {x[5] + x[3], 1.0 + x[2] - x[4], x[1]},
                            {-x[6], -x[7], 1.0}};
    const double N[3][3] = {{1.0 / radius, 0.0, -centre.x / radius}, {0.0, 1.0 / radius, -centre.y / radius}, {0, 0, 1}};
    const double back[3][3] = {{radius, 0.0, centre.x}, {0.0, radius, centre.y}, {0, 0, 1}};
    double h[3][3], a[3][3] = {}, b[3][3] = {}, c[3][3] = {};
    for (int i = 0; i < 9; ++i) h[i / 3][i % 3] = H[i];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) a[i][j] += M[i][k] * N[k][j];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) b[i][j] += back[i][k] * a[k][j];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) c[i][j] += b[i][k] * h[k][j];
    if (!(std::fabs(c[2][2]) > 1e-12)) return false;
    for (int i = 0; i < 9; ++i) H[i] = c[i / 3][i % 3] / c[2][2];
    return true;
}

struct RegisterRules {
    int polarity;
    double least_strength, relative_strength;
};

// Distances in px to what is hidden, 0 in it; without data nothing is.
using Clear = Image<std::uint8_t>;

// Whether the pixel at a place is hidden, or, with `by`, within so many px of it.
inline bool hidden_at(const Clear &clear, Vec p, double by = 0.0) {
    if (clear.data == nullptr) return false;
    const double right = static_cast<double>(clear.width) - 1.0, bottom = static_cast<double>(clear.height) - 1.0;
    const auto x = static_cast<std::ptrdiff_t>(std::lround(std::min(std::max(p.x, 0.0), right)));
    const auto y = static_cast<std::ptrdiff_t>(std::lround(std::min(std::max(p.y, 0.0), bottom)));
    return clear.data[y * clear.width + x] <= by;
}

// What is hidden has no edges, and what is beside it may have those of the hidden thing found in their place.
inline void leave_hidden_out(const Clear &clear, const Vec *at, const Vec *along, std::size_t m, Edge *edges) {
    if (clear.data == nullptr) return;
    for (std::size_t i = 0; i < m; ++i)
        if (hidden_at(clear, at[i]) ||
            (std::isfinite(edges[i].offset) && hidden_at(clear, at[i] + edges[i].offset * along[i])))
            edges[i].offset = edges[i].strength = std::numeric_limits<double>::quiet_NaN();
}

// `left` and `weight` are of the samples.
inline Registered register_outline(const Image<std::uint8_t> &image, const double *H, const double *points,
                                   const double *normals, const double *strength, std::size_t m, const double *reaches,
                                   const std::int64_t *motions, const std::int64_t *strides, std::size_t steps,
                                   const RegisterRules &rules, const Clear &clear, double *left,
                                   double *weight) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    Registered out, nothing;
    std::copy(H, H + 9, out.H);
    std::fill(nothing.H, nothing.H + 9, nan);
    std::fill(left, left + m, nan);
    std::fill(weight, weight + m, 0.0);
    std::vector<double> moved(5 * m);
    std::vector<Vec> at(m), along(m);
    std::vector<Edge> edges(m);
    std::vector<double> gains, residual, size;
    std::vector<std::size_t> index;
    const auto fail = [&] {
        std::fill(left, left + m, nan);
        std::fill(weight, weight + m, 0.0);
        return nothing;
    };
    for (std::size_t step = 0; step < steps; ++step) {
        const auto stride = static_cast<std::size_t>(strides[step]), n = (m + stride - 1) / stride;
        const auto asked = [&](std::size_t i) { return strength[i * stride]; };
        const auto direction = [&](std::size_t i) {
            if (rules.polarity != 0 || std::isinf(asked(i))) return rules.polarity;
            return asked(i) > 0 ? 1 : -1;
        };
        carry_normals(out.H, points, normals, static_cast<std::int64_t>(n), moved.data(), strides[step]);
        Vec centre{0, 0};
        for (std::size_t i = 0; i < n; ++i) {
            for (int j = 0; j < 5; ++j)
                if (!std::isfinite(moved[5 * i + j])) return fail();
            at[i] = {moved[5 * i], moved[5 * i + 1]};
            along[i] = {moved[5 * i + 2], moved[5 * i + 3]};
            centre = centre + at[i];
        }
        centre = (1.0 / static_cast<double>(n)) * centre;
        double spread = 0.0;
        for (std::size_t i = 0; i < n; ++i) spread += dot(at[i] - centre, at[i] - centre);
        const double radius = std::sqrt(spread / static_cast<double>(n));
        edge_search_each<false>(image, {at.data(), n}, along.data(), reaches[step], direction, edges.data());
        leave_hidden_out(clear, at.data(), along.data(), n, edges.data());
        gains.clear();
        for (std::size_t i = 0; i < n; ++i)
            if (std::isfinite(edges[i].offset) && std::fabs(edges[i].strength) >= rules.least_strength)
                gains.push_back(std::fabs(edges[i].strength) / std::fabs(asked(i)));
        const double gain = lower_median_in_place(gains);
        index.clear();
        for (std::size_t i = 0; i < n; ++i) {
            const double strong = std::fabs(edges[i].strength);
            if (std::isfinite(edges[i].offset) && strong >= rules.least_strength &&
                strong >= rules.relative_strength * gain * std::fabs(asked(i)))
                index.push_back(i);
        }
        if (index.size() < kEnough) return fail();
        Motions fit(index.size(), static_cast<int>(motions[step]));
        for (std::size_t k = 0; k < index.size(); ++k) {
            const Vec where = (1.0 / radius) * (at[index[k]] - centre), normal = along[index[k]];
            fit.set(k, where.x, where.y, normal.x, normal.y, edges[index[k]].offset);
        }
        residual.resize(index.size());
        size.resize(index.size());
        Row8 x = robust_motion(fit, residual, size, out.noise);
        for (double &value : x) value /= radius;
        if (!move(out.H, x, centre, radius)) return fail();
        std::fill(left, left + m, nan);
        std::fill(weight, weight + m, 0.0);
        for (std::size_t k = 0; k < index.size(); ++k) {
            left[index[k] * stride] = residual[k];
            weight[index[k] * stride] = fit.weights()[k];
        }
    }
    out.good = true;
    return out;
}

}  // namespace grasptrack
