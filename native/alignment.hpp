// SPDX-License-Identifier: Apache-2.0
// The cyclic shifts under which one outline lies on another. Defined in kernels/reference_alignment.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "geometry.hpp"

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

}  // namespace grasptrack
