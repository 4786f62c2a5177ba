// SPDX-License-Identifier: Apache-2.0
// The homography of four points (eq. (1)), and what homographies do to points and normals (eq. (2)).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "points.hpp"

namespace grasptrack {

struct Four {
    Vec p[4];
    Vec mean;
    double size;
    double weight[3];  // weight_0 p_0 + weight_1 p_1 + weight_2 p_2 is proportional to p_3

    explicit Four(const Vec *points) {
        mean = 0.25 * (points[0] + points[1] + points[2] + points[3]);
        double square = 0;
        for (int i = 0; i < 4; ++i) {
            p[i] = points[i] - mean;
            square += dot(p[i], p[i]);
        }
        size = std::sqrt(square / 4);
        if (!(size > 0) || !std::isfinite(size))
            throw std::invalid_argument("four points that coincide, or are not finite, fix no homography");
        for (Vec &v : p) v = (1 / size) * v;
        constexpr double in_a_row = 1e-10;
        for (int i = 0; i < 3; ++i) weight[i] = twice_area(p[(i + 1) % 3], p[(i + 2) % 3], p[3]);
        double least = std::fabs(twice_area(p[0], p[1], p[2]));
        for (double w : weight) least = std::min(least, std::fabs(w));
        if (!(least > in_a_row)) throw std::invalid_argument("three of the four points are in a row");
    }

    static double twice_area(Vec a, Vec b, Vec c) { return cross(b - a, c - a); }
};

inline void homography_4(const Vec *source, const Vec *target, double *H) {
    const Four s(source), t(target);
    double h[3][3] = {};
    for (int i = 0; i < 3; ++i) {
        const Vec a = s.p[(i + 1) % 3], b = s.p[(i + 2) % 3];
        const double ratio = t.weight[i] / s.weight[i];
        const double row[3] = {a.y - b.y, b.x - a.x, cross(a, b)};
        const double column[3] = {t.p[i].x, t.p[i].y, 1.0};
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) h[r][c] += ratio * column[r] * row[c];
    }
    // Back to px: T^-1 h S.
    double norm = 0;
    for (int c = 0; c < 3; ++c) {
        h[0][c] = t.size * h[0][c] + t.mean.x * h[2][c];
        h[1][c] = t.size * h[1][c] + t.mean.y * h[2][c];
    }
    for (int r = 0; r < 3; ++r) {
        const double x = h[r][0] / s.size, y = h[r][1] / s.size;
        H[3 * r] = x;
        H[3 * r + 1] = y;
        H[3 * r + 2] = h[r][2] - x * s.mean.x - y * s.mean.y;
        norm += H[3 * r] * H[3 * r] + H[3 * r + 1] * H[3 * r + 1] + H[3 * r + 2] * H[3 * r + 2];
    }
    norm = std::sqrt(norm);
    const double scale = std::fabs(H[8]) > 1e-12 * norm ? H[8] : norm;
    for (int i = 0; i < 9; ++i) H[i] /= scale;
}

// A closed contour at a place: Hermite's cubic, its tangents across the neighbours' chords.
inline Vec cubic_point(Points points, double place) {
    const std::size_t n = points.size, i = static_cast<std::size_t>(place);
    const double f = place - static_cast<double>(i);
    const Vec b = points[i];
    if (f == 0.0) return b;
    const Vec a = points[(i + n - 1) % n], c = points[(i + 1) % n], d = points[(i + 2) % n];
    const double ab = length(b - a), bc = length(c - b), cd = length(d - c);
    const Vec m = (ab + bc > 0 ? bc / (ab + bc) : 0.0) * (c - a), k = (bc + cd > 0 ? bc / (bc + cd) : 0.0) * (d - b);
    return b + f * (m + f * (3.0 * (c - b) - 2.0 * m - k + f * (2.0 * (b - c) + m + k)));
}

// Eq. (2) about one point: where it goes, the derivatives there, and lambda.
struct Local {
    Vec at;
    double xx, xy, yx, yy, lambda;
};

inline Local local(const double *H, Vec p) {
    const double w = H[6] * p.x + H[7] * p.y + H[8];
    const double u = (H[0] * p.x + H[1] * p.y + H[2]) / w, v = (H[3] * p.x + H[4] * p.y + H[5]) / w;
    return {{u, v}, (H[0] - H[6] * u) / w, (H[1] - H[7] * u) / w, (H[3] - H[6] * v) / w, (H[4] - H[7] * v) / w, w};
}

// Points of one view carried to the other, eq. (2); the least lambda, after the first one's sign.
inline double carry_points(const double *H, Points points, Vec *out) {
    double in_front = std::numeric_limits<double>::infinity(), side = 0;
    for (std::size_t i = 0; i < points.size; ++i) {
        const double x = points[i].x, y = points[i].y, w = H[6] * x + H[7] * y + H[8];
        if (i == 0) side = w < 0 ? -1 : 1;
        out[i] = {(H[0] * x + H[1] * y + H[2]) / w, (H[3] * x + H[4] * y + H[5]) / w};
        if (!(side * w >= in_front) && !std::isnan(in_front)) in_front = side * w;
    }
    return in_front;
}

struct Distortion {
    double in_front, determinant, ratio;
};

inline Distortion distortion(const double *H, Points points) {
    Distortion worst{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 1.0};
    double side = 0;
    for (std::size_t i = 0; i < points.size; ++i) {
        const auto [at, a, b, c, d, w] = local(H, points[i]);
        if (i == 0) side = w < 0 ? -1 : 1;
        const double det = a * d - b * c, square = a * a + b * b + c * c + d * d;
        // Singular values s1 >= s2 obey s1^2 + s2^2 = square and s1 s2 = det.
        const double larger = 0.5 * (square + std::sqrt(std::max(square * square - 4 * det * det, 0.0)));
        if (!(side * w >= worst.in_front)) worst.in_front = side * w;
        if (!(det >= worst.determinant)) worst.determinant = det;
        if (!(larger / det <= worst.ratio)) worst.ratio = larger / det;
    }
    for (int i = 0; i < 9; ++i)
        if (!std::isfinite(H[i])) worst.in_front = std::numeric_limits<double>::quiet_NaN();
    return worst;
}

// A point of an outline, its unit normal and the Jacobian's determinant there; NaN behind the camera.
struct CarriedNormal {
    Vec at, normal;
    double determinant;
};

// `front` is w at a place that is in front of the camera, which tells the sign of H.
inline CarriedNormal carry_normal(const double *H, double front, Vec point, Vec normal) {
    const auto [at, a, b, c, d, w] = local(H, point);
    if (!(w / front > 1e-9)) {
        constexpr double none = std::numeric_limits<double>::quiet_NaN();
        return {{none, none}, {none, none}, none};
    }
    const double px = d * normal.x - c * normal.y, py = a * normal.y - b * normal.x, determinant = a * d - b * c;
    const double size = std::sqrt(px * px + py * py) * (determinant > 0 ? 1.0 : determinant < 0 ? -1.0 : 0.0);
    return {at, {px / size, py / size}, determinant};
}

inline void carry_normals(const double *H, Points points, const Vec *normals, CarriedNormal *out) {
    double front = 0.0;
    for (std::size_t k = 0; k < points.size; ++k) front += H[6] * points[k].x + H[7] * points[k].y + H[8];
    front /= static_cast<double>(points.size);
    for (std::size_t k = 0; k < points.size; ++k) out[k] = carry_normal(H, front, points[k], normals[k]);
}

}  // namespace grasptrack
