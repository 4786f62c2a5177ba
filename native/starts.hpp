// SPDX-License-Identifier: Apache-2.0
// Whitened outlines, aligned at every shift. Defined in kernels/reference_starts.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "alignment.hpp"
#include "curvature.hpp"
#include "geometry.hpp"
#include "inertia.hpp"

namespace grasptrack {

using Matrix3 = std::array<double, 9>;

inline Matrix3 product(const Matrix3 &a, const Matrix3 &b) {
    Matrix3 out{};
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 3; ++k) out[3 * r + c] += a[3 * r + k] * b[3 * k + c];
    return out;
}

// The affine map after which the area within has mean 0 and unit second moments, without a turn.
inline Matrix3 whitening_of(Points points) {
    const std::int64_t offsets[] = {0, static_cast<std::int64_t>(points.size)};
    const Inertia m = inertia({points, offsets, 1});
    if (!(m.minor > 0)) throw std::invalid_argument("a contour must enclose an area");
    const double c = std::cos(m.theta), s = std::sin(m.theta), a = 1 / std::sqrt(m.major), b = 1 / std::sqrt(m.minor);
    const double xx = a * c * c + b * s * s, xy = (a - b) * c * s, yy = a * s * s + b * c * c;
    return {xx, xy, -xx * m.cx - xy * m.cy, xy, yy, -xy * m.cx - yy * m.cy, 0, 0, 1};
}

inline Vec affine(const Matrix3 &A, Vec p) {
    return {A[0] * p.x + A[1] * p.y + A[2], A[3] * p.x + A[4] * p.y + A[5]};
}

// Equal steps of arc length, centred and of unit norm.
inline std::vector<Pair> unit_samples(const std::vector<Vec> &points, std::size_t count) {
    std::vector<Vec> at(count);
    resample({points.data(), points.size()}, count, 0.0, at.data());
    std::vector<Pair> out(count);
    Vec mean{0, 0};
    for (const Vec &p : at) mean = mean + p;
    mean = (1 / static_cast<double>(count)) * mean;
    double square = 0;
    for (Vec &p : at) {
        p = p - mean;
        square += dot(p, p);
    }
    const double scale = 1 / std::sqrt(square);
    for (std::size_t i = 0; i < count; ++i) out[i] = pair(scale * at[i]);
    return out;
}

struct Start {
    double left, shift;
    Matrix3 H;
};

inline std::vector<Start> initial_alignments(Points first, Points second, const Vec *bends, std::size_t bend_count,
                                         std::size_t count, double apart, std::size_t most) {
    constexpr double in_front = 0.25;
    const Matrix3 to_first = whitening_of(first), to_second = whitening_of(second);
    std::vector<Vec> white(first.size), other(second.size), bent(first.size), again_white(first.size);
    for (std::size_t i = 0; i < first.size; ++i) white[i] = affine(to_first, first[i]);
    for (std::size_t i = 0; i < second.size; ++i) other[i] = affine(to_second, second[i]);
    const std::vector<Pair> b = unit_samples(other, count);
    const double det = to_second[0] * to_second[4] - to_second[1] * to_second[3];
    const double ia = to_second[4] / det, ib = -to_second[1] / det, ic = -to_second[3] / det, id = to_second[0] / det;
    const Matrix3 back = {ia, ib, -ia * to_second[2] - ib * to_second[5],
                          ic, id, -ic * to_second[2] - id * to_second[5],
                          0,  0,  1};
    std::vector<Start> rows;
    std::vector<double> square(count);
    for (std::size_t t = 0; t < bend_count; ++t) {
        double least = 1e300;
        for (std::size_t i = 0; i < white.size(); ++i) {
            const double w = dot(white[i], bends[t]) + 1;
            least = std::min(least, w);
            bent[i] = (1 / w) * white[i];
        }
        if (least < in_front) continue;
        const Matrix3 again = whitening_of({bent.data(), bent.size()});
        for (std::size_t i = 0; i < bent.size(); ++i) again_white[i] = affine(again, bent[i]);
        const std::vector<Pair> c = cyclic_correlation(unit_samples(again_white, count), b);
        const Matrix3 bend = {1, 0, 0, 0, 1, 0, bends[t].x, bends[t].y, 1};
        const Matrix3 ahead = product(again, product(bend, to_first));
        for (std::size_t k = 0; k < count; ++k) square[k] = dot(c[k], c[k]);
        for (std::size_t k = 0; k < count; ++k) {
            if (!(square[k] >= square[k > 0 ? k - 1 : count - 1] && square[k] > square[k + 1 < count ? k + 1 : 0]))
                continue;
            const double size = std::sqrt(square[k]), cosine = c[k][0] / size, sine = c[k][1] / size;
            Start row{std::sqrt(std::max(1 - square[k], 0.0)), static_cast<double>(k) / static_cast<double>(count),
                      product(back, product({cosine, -sine, 0, sine, cosine, 0, 0, 0, 1}, ahead))};
            for (int i = 0; i < 9; ++i) row.H[i] /= i < 8 ? row.H[8] : 1.0;
            row.H[8] = 1.0;
            rows.push_back(row);
        }
    }
    std::stable_sort(rows.begin(), rows.end(), [](const Start &a, const Start &b) { return a.left < b.left; });
    std::vector<Start> kept;
    for (const Start &row : rows) {
        if (kept.size() >= most) break;
        bool alone = true;
        for (const Start &other : kept) {
            double gap = std::fmod(row.shift - other.shift + 1.5, 1.0) - 0.5;
            alone = alone && std::fabs(gap) >= apart;
        }
        if (alone) kept.push_back(row);
    }
    return kept;
}

}  // namespace grasptrack
