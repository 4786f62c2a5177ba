// SPDX-License-Identifier: Apache-2.0
// Area, centroid and inertia of the material inside contours, by Green's theorem (Section III-B).
#pragma once

#include "points.hpp"

namespace grasptrack {

struct Moments {
    double area, x, y, angle, major, minor, t30, t21, t12, t03;
};

// Sums over the edges of a polygon, two edges at a time.
struct EdgeSums {
    Pair m00 = both(0), m10 = m00, m01 = m00, m20 = m00, m11 = m00, m02 = m00;
    Pair m30 = m00, m21 = m00, m12 = m00, m03 = m00;

    // Edges from (x, y) to (X, Y).
    void add(Pair x, Pair y, Pair X, Pair Y) {
        const Pair a = x * Y - X * y, sx = x + X, sy = y + Y, ax = a * sx, ay = a * sy, axy = ax * sy;
        const Pair xx = x * x, XX = X * X, yy = y * y, YY = Y * Y, qx = xx + XX, qy = yy + YY;
        m00 = m00 + a;
        m10 = m10 + ax;
        m01 = m01 + ay;
        m20 = m20 + (ax * sx + a * qx);
        m11 = m11 + (axy + a * (x * y + X * Y));
        m02 = m02 + (ay * sy + a * qy);
        m30 = m30 + ax * qx;
        m21 = m21 + (axy * sx + (a + a) * (xx * y + XX * Y));
        m12 = m12 + (axy * sy + (a + a) * (yy * x + YY * X));
        m03 = m03 + ay * qy;
    }

    void add(Points points, Vec origin) {
        const std::size_t n = points.size;
        std::size_t i = 0;
        for (; i + 2 < n; i += 2) {
            const Vec p = points[i] - origin, q = points[i + 1] - origin, r = points[i + 2] - origin;
            add(Pair{p.x, q.x}, Pair{p.y, q.y}, Pair{q.x, r.x}, Pair{q.y, r.y});
        }
        for (; i < n; ++i) {
            const Vec p = points[i] - origin, q = points[i + 1 < n ? i + 1 : 0] - origin;
            add(Pair{p.x, 0}, Pair{p.y, 0}, Pair{q.x, 0}, Pair{q.y, 0});
        }
    }
};

inline Moments polygon_moments(const Outline &outline) {
    constexpr double symmetric = 1e-9;
    constexpr double pi = 3.14159265358979323846;
    const Vec origin = outline.points[0];
    EdgeSums sums;
    for (std::size_t c = 0; c < outline.contours; ++c) sums.add(outline.contour(c), origin);
    const auto total = [](Pair lanes) { return lanes[0] + lanes[1]; };
    const double m00 = total(sums.m00) / 2, m10 = total(sums.m10), m01 = total(sums.m01);
    const double m20 = total(sums.m20) / 2, m02 = total(sums.m02) / 2, m11 = total(sums.m11);
    const double m30 = total(sums.m30), m03 = total(sums.m03), m21 = total(sums.m21), m12 = total(sums.m12);
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
