// SPDX-License-Identifier: Apache-2.0
// The homography of four points (eq. (1)).
#pragma once

#include <algorithm>
#include <limits>

#include "geometry.hpp"

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
        const double x = points[i].x, y = points[i].y, w = H[6] * x + H[7] * y + H[8];
        if (i == 0) side = w < 0 ? -1 : 1;
        const double u = (H[0] * x + H[1] * y + H[2]) / w, v = (H[3] * x + H[4] * y + H[5]) / w;
        const double a = (H[0] - H[6] * u) / w, b = (H[1] - H[7] * u) / w;
        const double c = (H[3] - H[6] * v) / w, d = (H[4] - H[7] * v) / w;
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

}  // namespace grasptrack
