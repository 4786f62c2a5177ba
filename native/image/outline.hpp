// SPDX-License-Identifier: Apache-2.0
// What to search along an outline, and what to make of the edges found.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "../geometry/curve.hpp"
#include "edges.hpp"

namespace grasptrack {

inline void settle_edges(const double *points, const double *normals, const double *edges, std::int64_t columns,
                         const bool *fixed, std::int64_t n, double fallback, double outlier, double *out_points,
                         double *out_strength) {
    std::vector<double> offset(n);
    for (std::int64_t i = 0; i < n; ++i) {
        const double o = edges[columns * i];
        offset[i] = std::isnan(o) ? fallback : o;
    }
    for (std::int64_t i = 0; i < n; ++i) {
        std::array<double, 5> five;
        for (int k = 0; k < 5; ++k) five[k] = offset[(i + k - 2 + n) % n];
        std::nth_element(five.begin(), five.begin() + 2, five.end());
        const bool stray = std::abs(offset[i] - five[2]) > outlier;
        const double by = fixed[i] ? 0.0 : stray ? five[2] : offset[i];
        const bool counted = !fixed[i] && !stray && !std::isnan(edges[columns * i]);
        out_points[2 * i] = points[2 * i] + by * normals[2 * i];
        out_points[2 * i + 1] = points[2 * i + 1] + by * normals[2 * i + 1];
        out_strength[i] = counted ? std::abs(edges[columns * i + 1]) : 0.0;
    }
}

// From the chain of pixels round a silhouette to sub-pixel points.

struct Tracing {
    double spacing, most, smoothing, reach, border, outlier;
    bool hole;
    int polarity;
};

struct Traced {
    std::vector<Vec> points;
    std::vector<double> strength;
    std::unique_ptr<bool[]> cut;
    double inside = std::numeric_limits<double>::quiet_NaN(), outside = std::numeric_limits<double>::quiet_NaN();
};

inline double median_of(std::vector<double> &values) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

inline Traced trace_edges(const Image<std::uint8_t> &image, const std::int32_t *chain, std::size_t n,
                          const std::uint8_t *hidden, const Tracing &how) {
    std::vector<Vec> rough(n);
    double area = 0.0, around = 0.0;
    for (std::size_t i = 0; i < n; ++i)
        rough[i] = {static_cast<double>(chain[2 * i]), static_cast<double>(chain[2 * i + 1])};
    for (std::size_t i = 0; i < n; ++i) {
        const Vec a = rough[i], b = rough[i + 1 < n ? i + 1 : 0];
        area += cross(a - rough[0], b - rough[0]);
        around += length(b - a);
    }
    if ((area > 0) == how.hole) std::reverse(rough.begin(), rough.end());
    const auto count = static_cast<std::size_t>(std::clamp(std::nearbyint(around / how.spacing), 16.0, how.most));

    Traced out;
    out.points.resize(count);
    out.strength.resize(count);
    out.cut = std::make_unique<bool[]>(count);
    std::vector<Vec> points(count), normals(count);
    std::vector<Edge> edges(count);
    resample({rough.data(), n}, count, std::min(how.smoothing, around), points.data());
    blend_normals({points.data(), count}, normals.data());
    const double right = static_cast<double>(image.width - 1), bottom = static_cast<double>(image.height - 1);
    for (std::size_t i = 0; i < count; ++i) {
        const Vec p = points[i];
        bool cut = p.x < how.border || p.y < how.border || p.x > right - how.border || p.y > bottom - how.border;
        if (hidden != nullptr) {
            const auto x = static_cast<std::ptrdiff_t>(std::clamp(std::nearbyint(p.x), 0.0, right));
            const auto y = static_cast<std::ptrdiff_t>(std::clamp(std::nearbyint(p.y), 0.0, bottom));
            cut = cut || hidden[y * image.width + x] != 0;
        }
        out.cut[i] = cut;
    }
    search_along_normals(image, {points.data(), count}, normals.data(), how.reach, how.polarity, edges.data());
    // Where no edge is found the silhouette's own boundary, half a pixel outside the pixels' centres, is the best guess.
    settle_edges(&points[0].x, &normals[0].x, &edges[0].offset, sizeof(Edge) / sizeof(double), out.cut.get(),
                 static_cast<std::int64_t>(count), 0.5, how.outlier, &out.points[0].x, out.strength.data());
    std::vector<double> inside, outside;
    for (std::size_t i = 0; i < count; i += std::max<std::size_t>(1, count / 100))
        if (out.strength[i] > 0.0) {
            inside.push_back(edges[i].inside);
            outside.push_back(edges[i].outside);
        }
    out.inside = median_of(inside);
    out.outside = median_of(outside);
    return out;
}

}  // namespace grasptrack
