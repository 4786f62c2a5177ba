// SPDX-License-Identifier: Apache-2.0
// A grey image and its halves, looked at through a homography.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "matrix.hpp"

namespace grasptrack::pose {

struct Level {
    const std::uint8_t *data;
    std::ptrdiff_t height, width;
    const std::uint8_t *hidden = nullptr;  // nonzero where a pixel shows nothing of the scene

    bool holds(double x, double y, double margin) const {
        if (!(x >= margin && y >= margin && x < static_cast<double>(width) - 1.0 - margin &&
              y < static_cast<double>(height) - 1.0 - margin))
            return false;
        return !hidden || !hidden[static_cast<std::ptrdiff_t>(y + 0.5) * width + static_cast<std::ptrdiff_t>(x + 0.5)];
    }
    // Bilinear; the point must lie inside.
    double at(double x, double y) const {
        const auto a = static_cast<std::ptrdiff_t>(x), b = static_cast<std::ptrdiff_t>(y);
        const double fx = x - static_cast<double>(a), fy = y - static_cast<double>(b);
        const std::uint8_t *p = data + b * width + a;
        const double top = p[0] + fx * (p[1] - p[0]);
        const double bottom = p[width] + fx * (p[width + 1] - p[width]);
        return top + fy * (bottom - top);
    }
    // The same of n points; in loops that the compiler can take several at a time.
    GRASPTRACK_WIDE void at(const double *x, const double *y, int n, double *out) const {
        constexpr int most = 64;
        std::int32_t where[most], corner[most], right[most], below[most], across[most];
        double fx[most], fy[most];
        const auto row = static_cast<double>(width);
        for (int first = 0; first < n; first += most) {
            const int m = std::min(most, n - first);
            for (int i = 0; i < m; ++i) {
                const double a = static_cast<std::int32_t>(x[first + i]), b = static_cast<std::int32_t>(y[first + i]);
                fx[i] = x[first + i] - a;
                fy[i] = y[first + i] - b;
                where[i] = static_cast<std::int32_t>(b * row + a);
            }
            for (int i = 0; i < m; ++i) {
                const std::uint8_t *p = data + where[i];
                corner[i] = p[0];
                right[i] = p[1];
                below[i] = p[width];
                across[i] = p[width + 1];
            }
            for (int i = 0; i < m; ++i) {
                const double top = corner[i] + fx[i] * (right[i] - corner[i]), bottom = below[i] + fx[i] * (across[i] - below[i]);
                out[first + i] = top + fy[i] * (bottom - top);
            }
        }
    }
};

using Pyramid = std::vector<Level>;

struct Seen {  // a level, and the homography that leads to its pixels
    const Level *level;
    Homography H;
};

// The level on which steps of `stride` in the plane that H carries to the image are nearest to a pixel, and never much
// more: px are averaged over, not skipped. `x`, `y`: where the step is measured.
inline Seen look_through(const Pyramid &pyramid, const Homography &H, double x, double y, double stride) {
    const auto d = derivatives(H, x, y);
    double step = stride * std::sqrt(std::abs(d[0] * d[3] - d[1] * d[2]));
    std::size_t k = 0;
    Homography h = H;
    while (step > 1.5 && k + 1 < pyramid.size()) {
        step *= 0.5;
        ++k;
        for (int i = 0; i < 6; ++i) h[static_cast<std::size_t>(i)] *= 0.5;
    }
    return {&pyramid[k], h};
}

}  // namespace grasptrack::pose
