// SPDX-License-Identifier: Apache-2.0
// What to search along an outline, and what to make of the edges found. Defined in kernels/reference_evidence.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

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

// `out` has 5 elements. `front` is w at a place that is in front of the camera, which tells the sign of H.
inline void carry_normal(const double *H, double front, const double *point, const double *normal, double *out) {
    const double x = point[0], y = point[1], nx = normal[0], ny = normal[1];
    const double w = H[6] * x + H[7] * y + H[8];
    if (!(w / front > 1e-9)) {
        std::fill(out, out + 5, std::numeric_limits<double>::quiet_NaN());
        return;
    }
    const double u = (H[0] * x + H[1] * y + H[2]) / w, v = (H[3] * x + H[4] * y + H[5]) / w;
    const double a = (H[0] - H[6] * u) / w, b = (H[1] - H[7] * u) / w;
    const double c = (H[3] - H[6] * v) / w, d = (H[4] - H[7] * v) / w;
    const double px = d * nx - c * ny, py = a * ny - b * nx, determinant = a * d - b * c;
    const double size = std::sqrt(px * px + py * py) * (determinant > 0 ? 1.0 : determinant < 0 ? -1.0 : 0.0);
    out[0] = u, out[1] = v, out[2] = px / size, out[3] = py / size, out[4] = determinant;
}

inline void carry_normals(const double *H, const double *points, const double *normals, std::int64_t n, double *out) {
    double front = 0.0;
    for (std::int64_t k = 0; k < n; ++k) front += H[6] * points[2 * k] + H[7] * points[2 * k + 1] + H[8];
    front /= static_cast<double>(n);
    for (std::int64_t k = 0; k < n; ++k) carry_normal(H, front, points + 2 * k, normals + 2 * k, out + 5 * k);
}

}  // namespace grasptrack
