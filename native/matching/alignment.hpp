// SPDX-License-Identifier: Apache-2.0
// The cyclic shifts under which one outline lies on another.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "../geometry/curve.hpp"
#include "../geometry/points.hpp"
#include "../geometry/moments.hpp"

namespace grasptrack {

// A contour at equal steps of its arc length, centred and of unit norm.
inline void centred_samples(Points points, const double *arc, std::size_t count, Pair *out) {
    const double spacing = arc[points.size] / static_cast<double>(count);
    Pair mean = both(0);
    for (std::size_t k = 0, i = 0; k < count; ++k) {
        const double s = static_cast<double>(k) * spacing;
        while (i + 1 < points.size && arc[i + 1] <= s) ++i;
        const double width = arc[i + 1] - arc[i], f = width > 0 ? (s - arc[i]) / width : 0;
        const Vec side = points[i + 1 < points.size ? i + 1 : 0] - points[i];
        out[k] = pair(points[i] - points[0]) + both(f) * pair(side);
        mean = mean + out[k];
    }
    mean = both(1 / static_cast<double>(count)) * mean;
    Pair square = both(0);
    for (std::size_t k = 0; k < count; ++k) {
        out[k] = out[k] - mean;
        square = square + out[k] * out[k];
    }
    const Pair scale = both(1 / std::sqrt(square[0] + square[1]));
    for (std::size_t k = 0; k < count; ++k) out[k] = scale * out[k];
}

// The discrete Fourier transform of a power of 2 of complex numbers (Stockham's form); `room` takes as many.
class Fourier {
  public:
    explicit Fourier(std::size_t count) : count_(count), cosine_(count / 2), sine_(count / 2) {
        for (std::size_t j = 0; j < count / 2; ++j) {
            const double angle = -6.28318530717958647692 * static_cast<double>(j) / static_cast<double>(count);
            cosine_[j] = both(std::cos(angle));
            sine_[j] = Pair{-std::sin(angle), std::sin(angle)};
        }
    }

    std::size_t count() const { return count_; }

    void transform(std::vector<Pair> &x, std::vector<Pair> &room) const {
        for (std::size_t half = count_ / 2, stride = 1; half >= 1; half /= 2, stride *= 2) {
            for (std::size_t p = 0; p < half; ++p) {
                const Pair cosine = cosine_[p * stride], sine = sine_[p * stride];
                const Pair *a = x.data() + stride * p, *b = a + stride * half;
                Pair *out = room.data() + 2 * stride * p;
                for (std::size_t q = 0; q < stride; ++q) {
                    const Pair gap = a[q] - b[q];
                    out[q] = a[q] + b[q];
                    out[q + stride] = cosine * gap + sine * Pair{gap[1], gap[0]};
                }
            }
            x.swap(room);
        }
    }

  private:
    std::size_t count_;
    std::vector<Pair> cosine_, sine_;
};

// c_k = sum_i conj(a_i) b_(i + k), real and imaginary part, for all k, by the transforms of both.
inline std::vector<Pair> cyclic_correlation(std::vector<Pair> a, std::vector<Pair> b) {
    thread_local Fourier fourier(64);
    if (fourier.count() != a.size()) fourier = Fourier(a.size());
    std::vector<Pair> room(a.size());
    fourier.transform(a, room);
    fourier.transform(b, room);
    // the inverse transform of b conj(a) is the conjugate of the transform of its conjugate
    const double share = 1 / static_cast<double>(a.size());
    for (std::size_t k = 0; k < a.size(); ++k)
        a[k] = both(share) * Pair{a[k][0] * b[k][0] + a[k][1] * b[k][1], a[k][1] * b[k][0] - a[k][0] * b[k][1]};
    fourier.transform(a, room);
    for (Pair &c : a) c[1] = -c[1];
    return a;
}

struct Fit {
    double shift, angle, residual;
};

inline std::vector<Fit> align_outlines(Points points1, const double *arc1, Points points2, const double *arc2,
                                       std::size_t count, double tie) {
    std::vector<Pair> a(count), b(count);
    centred_samples(points1, arc1, count, a.data());
    centred_samples(points2, arc2, count, b.data());
    const std::vector<Pair> c = cyclic_correlation(std::move(a), std::move(b));
    std::vector<double> square(count), residual(count);
    for (std::size_t k = 0; k < count; ++k) {
        square[k] = dot(c[k], c[k]);
        residual[k] = std::sqrt(std::max(1 - square[k], 0.0));
    }
    const double limit = *std::min_element(residual.begin(), residual.end()) + tie;
    std::vector<Fit> found;
    for (std::size_t k = 0; k < count; ++k)
        if (residual[k] <= limit && square[k] >= square[k > 0 ? k - 1 : count - 1] &&
            square[k] > square[k + 1 < count ? k + 1 : 0])
            found.push_back({static_cast<double>(k) / static_cast<double>(count), std::atan2(c[k][1], c[k][0]),
                             residual[k]});
    std::stable_sort(found.begin(), found.end(), [](const Fit &a, const Fit &b) { return a.residual < b.residual; });
    return found;
}

// Whitened outlines, aligned at every shift.

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
    const Moments m = polygon_moments({points, offsets, 1});
    if (!(m.minor > 0)) throw std::invalid_argument("a contour must enclose an area");
    const double c = std::cos(m.angle), s = std::sin(m.angle), a = 1 / std::sqrt(m.major), b = 1 / std::sqrt(m.minor);
    const double xx = a * c * c + b * s * s, xy = (a - b) * c * s, yy = a * s * s + b * c * c;
    return {xx, xy, -xx * m.x - xy * m.y, xy, yy, -xy * m.x - yy * m.y, 0, 0, 1};
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
