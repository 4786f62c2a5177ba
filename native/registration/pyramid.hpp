// SPDX-License-Identifier: Apache-2.0
// A grey image and its halves, looked at through a homography.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
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
    GRASPTRACK_WITHIN void at(const double *x, const double *y, int n, double *out) const {
        constexpr int most = 64;
        std::int32_t where[most];
        std::uint16_t above[most], below[most];  // two pixels side by side each
        double fx[most], fy[most];
        const auto row = static_cast<double>(width);
        const std::uint16_t one = 1;
        std::uint8_t low;
        std::memcpy(&low, &one, 1);
        const int left = low ? 0 : 8, right = 8 - left;  // bits: where the processor puts them
        for (int first = 0; first < n; first += most) {
            const int m = std::min(most, n - first);
            for (int i = 0; i < m; ++i) {
                const double a = static_cast<std::int32_t>(x[first + i]), b = static_cast<std::int32_t>(y[first + i]);
                fx[i] = x[first + i] - a;
                fy[i] = y[first + i] - b;
                where[i] = static_cast<std::int32_t>(b * row + a);
            }
            for (int i = 0; i < m; ++i) {
                std::memcpy(above + i, data + where[i], 2);
                std::memcpy(below + i, data + where[i] + width, 2);
            }
            for (int i = 0; i < m; ++i) {
                const std::int32_t a = above[i] >> left & 255, b = above[i] >> right & 255, c = below[i] >> left & 255, d = below[i] >> right & 255;
                const double top = a + fx[i] * (b - a), bottom = c + fx[i] * (d - c);
                out[first + i] = top + fy[i] * (bottom - top);
            }
        }
    }
};

using Pyramid = std::vector<Level>;

// A level, where a point of the plane lies on it, and the derivatives there: dx'/dx, dx'/dy, dy'/dx, dy'/dy.
struct SeenPoint {
    const Level *level;
    Point at;
    std::array<double, 4> by;
};

// The level on which steps of `stride` in the plane that H carries to the image are nearest to a pixel, and never much
// more: px are averaged over, not skipped.
GRASPTRACK_WITHIN SeenPoint look_at(const Pyramid &pyramid, const Homography &H, Point p, double stride) {
    SeenPoint seen{pyramid.data(), carried(H, p.x, p.y), derivatives(H, p.x, p.y)};
    double step = stride * std::sqrt(std::abs(seen.by[0] * seen.by[3] - seen.by[1] * seen.by[2])), scale = 1;
    for (; step > 1.5 && seen.level != &pyramid.back(); ++seen.level) step *= 0.5, scale *= 0.5;
    seen.at = {scale * seen.at.x, scale * seen.at.y};
    for (double &value : seen.by) value *= scale;
    return seen;
}

struct Seen {  // a level, and the homography that leads to its pixels
    const Level *level;
    Homography H;
};

// The same of all that lies about a point.
inline Seen look_through(const Pyramid &pyramid, const Homography &H, Point p) {
    Seen seen{look_at(pyramid, H, p, 1.0).level, H};
    const double scale = 1.0 / static_cast<double>(std::size_t{1} << (seen.level - pyramid.data()));
    for (std::size_t i = 0; i < 6; ++i) seen.H[i] *= scale;
    return seen;
}

}  // namespace grasptrack::pose
