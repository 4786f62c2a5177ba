// SPDX-License-Identifier: Apache-2.0
// By how much an image differs from the reference at some places. Defined in kernels/reference_fusion.py.
#pragma once

#include "surface.hpp"

namespace grasptrack {

constexpr double kDistinct = 5.0;

// NaN where nothing can be compared; gives the noise.
inline double grey_differences(const Image<std::uint8_t> &coarse, double shrink, const double *H, const Vec *places,
                               const double *values, std::size_t p, double least_noise, double *out) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    std::fill(out, out + p, nan);
    double h[9];
    for (int i = 0; i < 9; ++i) h[i] = H[i] / H[8];
    const double right = static_cast<double>(coarse.width) - 1 - kEdge, by = 1.0 / shrink;
    const double bottom = static_cast<double>(coarse.height) - 1 - kEdge;
    enum { kSeen, kWanted, kX, kY, kRest, kWeight, kSize, kAll };
    Columns columns(kAll, p);
    double *seen = columns[kSeen], *wanted = columns[kWanted], *x = columns[kX], *y = columns[kY], *rest = columns[kRest];
    double *some = columns[kSize];
    std::vector<std::size_t> told(p);
    Selection select;
    std::size_t n = 0;
    for (std::size_t i = 0; i < p; ++i) {
        const double w = h[6] * places[i].x + h[7] * places[i].y + 1.0;
        if (!(w > 1e-9) || !std::isfinite(values[i])) continue;
        const double over = 1.0 / w;
        const Vec u{(h[0] * places[i].x + h[1] * places[i].y + h[2]) * over,
                    (h[3] * places[i].x + h[4] * places[i].y + h[5]) * over};
        const Vec v{(u.x + 0.5) * by - 0.5, (u.y + 0.5) * by - 0.5};
        if (!(v.x >= kEdge && v.y >= kEdge && v.x < right && v.y < bottom)) continue;
        told[n] = i, x[n] = u.x, y[n] = u.y, seen[n] = coarse.sample(v), wanted[n] = values[i];
        ++n;
    }
    if (n < kFewest) return nan;
    const double count = static_cast<double>(n), middle = select(wanted, n, (n - 1) / 2);
    double levels[2][2];  // wanted and seen, of the darker and of the lighter half
    for (int lighter = 0; lighter < 2; ++lighter)
        for (int which = 0; which < 2; ++which) {
            const double *from = which == 0 ? wanted : seen;
            std::size_t kept = 0;
            for (std::size_t i = 0; i < n; ++i) {
                some[kept] = from[i];
                kept += (lighter ? wanted[i] >= middle : wanted[i] <= middle) ? 1 : 0;
            }
            levels[lighter][which] = select(some, kept, (kept - 1) / 2);
        }
    const double before = levels[1][0] - levels[0][0];
    const double gain = before > kDistinct ? (levels[1][1] - levels[0][1]) / before : 1.0;
    Vec centre{0, 0};
    double mean = 0.0, spread = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        rest[i] = seen[i] - gain * wanted[i];
        centre = centre + Vec{x[i], y[i]}, mean += wanted[i];
    }
    const double level = select(rest, n, (n - 1) / 2);
    centre = (1.0 / count) * centre;
    mean /= count;
    for (std::size_t i = 0; i < n; ++i) {
        rest[i] -= level, wanted[i] -= mean, x[i] -= centre.x, y[i] -= centre.y;
        spread += x[i] * x[i] + y[i] * y[i];
    }
    const double unit = 1.0 / (std::sqrt(spread / (2.0 * count)) + 1e-9);
    for (std::size_t i = 0; i < n; ++i) x[i] *= unit, y[i] *= unit;
    const LightFit fit = fit_light(wanted, x, y, seen, n, least_noise, rest, columns[kWeight], some, select);
    for (std::size_t i = 0; i < n; ++i) out[told[i]] = rest[i];
    return fit.noise;
}

}  // namespace grasptrack
