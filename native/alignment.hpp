// SPDX-License-Identifier: Apache-2.0
// The cyclic shifts under which one outline lies on another. Defined in kernels/reference_alignment.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
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

// c_k = sum_i conj(a_i) b_(i + k), real and imaginary part, for all k.
inline void cyclic_correlation(const Pair *a, const Pair *b, std::size_t count, Pair *out) {
    constexpr std::size_t block = 4;  // shifts that are summed in registers
    std::vector<Pair> real(2 * count + block), turned(2 * count + block);
    for (std::size_t i = 0, j = 0; i < real.size(); ++i, j = j + 1 < count ? j + 1 : 0) {
        real[i] = b[j];
        turned[i] = Pair{b[j][1], -b[j][0]};
    }
    for (std::size_t k = 0; k < count; k += block) {
        Pair sum[block] = {both(0), both(0), both(0), both(0)};
        for (std::size_t i = 0; i < count; ++i) {
            const Pair x = both(a[i][0]), y = both(a[i][1]);
            for (std::size_t j = 0; j < block; ++j) sum[j] = sum[j] + (x * real[i + k + j] + y * turned[i + k + j]);
        }
        for (std::size_t j = 0; j < block && k + j < count; ++j) out[k + j] = sum[j];
    }
}

struct Fit {
    double shift, angle, residual;
};

inline std::vector<Fit> align_outlines(Points points1, const double *arc1, Points points2, const double *arc2,
                                       std::size_t count, double tie) {
    std::vector<Pair> a(count), b(count), c(count);
    centred_samples(points1, arc1, count, a.data());
    centred_samples(points2, arc2, count, b.data());
    cyclic_correlation(a.data(), b.data(), count, c.data());
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
            found.push_back({static_cast<double>(k) / static_cast<double>(count), std::atan2(c[k][1], c[k][0]), residual[k]});
    std::stable_sort(found.begin(), found.end(), [](const Fit &a, const Fit &b) { return a.residual < b.residual; });
    return found;
}

}  // namespace grasptrack
