// SPDX-License-Identifier: Apache-2.0
// Area, centroid and inertia of the material inside contours, by Green's theorem (Section III-B).
#pragma once

#include "geometry.hpp"

namespace grasptrack {

struct Inertia {
    double area, cx, cy, theta, major, minor, t30, t21, t12, t03;
};

inline Inertia inertia(const Outline &outline) {
    constexpr double symmetric = 1e-9;
    constexpr double pi = 3.14159265358979323846;
    const Vec origin = outline.points[0];
    double m00 = 0, m10 = 0, m01 = 0, m20 = 0, m02 = 0, m11 = 0, m30 = 0, m03 = 0, m21 = 0, m12 = 0;
    for (std::size_t c = 0; c < outline.contours; ++c) {
        const Points points = outline.contour(c);
        if (points.size == 0) continue;
        Vec p = points[points.size - 1] - origin;
        for (std::size_t i = 0; i < points.size; ++i) {
            const Vec q = points[i] - origin;
            const double x = p.x, y = p.y, X = q.x, Y = q.y;
            const double a = x * Y - X * y;
            const double xx = x * x, xX = x * X, XX = X * X, yy = y * y, yY = y * Y, YY = Y * Y;
            m00 += a;
            m10 += a * (x + X);
            m01 += a * (y + Y);
            m20 += a * (xx + xX + XX);
            m02 += a * (yy + yY + YY);
            m11 += a * (2 * (x * y + X * Y) + x * Y + X * y);
            m30 += a * (x + X) * (xx + XX);
            m03 += a * (y + Y) * (yy + YY);
            m21 += a * (xx * (3 * y + Y) + 2 * xX * (y + Y) + XX * (y + 3 * Y));
            m12 += a * (yy * (3 * x + X) + 2 * yY * (x + X) + YY * (x + 3 * X));
            p = q;
        }
    }
    m00 /= 2;
    const double gx = m10 / 6 / m00, gy = m01 / 6 / m00;
    // About the centroid, per area.
    const double c20 = m20 / 12 / m00 - gx * gx, c02 = m02 / 12 / m00 - gy * gy, c11 = m11 / 24 / m00 - gx * gy;
    const double c30 = m30 / 20 / m00 - 3 * gx * c20 - gx * gx * gx;
    const double c03 = m03 / 20 / m00 - 3 * gy * c02 - gy * gy * gy;
    const double c21 = m21 / 60 / m00 - gy * c20 - 2 * gx * c11 - gx * gx * gy;
    const double c12 = m12 / 60 / m00 - gx * c02 - 2 * gy * c11 - gx * gy * gy;
    const double mean = (c20 + c02) / 2, half = (c20 - c02) / 2, radius = std::sqrt(half * half + c11 * c11);
    double theta = 0.5 * std::atan2(c11, half);
    // Exactly upright, atan2 may answer -pi: the half-open interval keeps +pi/2.
    if (theta <= -0.5 * pi) theta = 0.5 * pi;
    const double c = std::cos(theta), s = std::sin(theta), cc = c * c, ss = s * s, cs = c * s;
    const double size = std::fabs(m00) * std::sqrt(std::fabs(m00));
    double t30 = (c * cc * c30 + 3 * cc * s * c21 + 3 * c * ss * c12 + s * ss * c03) / size;
    double t21 = (-c * cs * c30 + c * (cc - 2 * ss) * c21 + s * (2 * cc - ss) * c12 + cs * s * c03) / size;
    double t12 = (cs * s * c30 + s * (ss - 2 * cc) * c21 + c * (cc - 2 * ss) * c12 + c * cs * c03) / size;
    double t03 = (-s * ss * c30 + 3 * c * ss * c21 - 3 * cc * s * c12 + c * cc * c03) / size;
    const double qu = t30 + t12, qv = t21 + t03;
    if (qu < -symmetric || (std::fabs(qu) <= symmetric && qv < -symmetric)) {
        theta += theta > 0 ? -pi : pi;
        t30 = -t30, t21 = -t21, t12 = -t12, t03 = -t03;
    }
    return {m00, origin.x + gx, origin.y + gy, theta, mean + radius, mean - radius, t30, t21, t12, t03};
}

}  // namespace grasptrack
