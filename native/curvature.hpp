// SPDX-License-Identifier: Apache-2.0
// Curvature, resampling and vertex normals of one closed contour.
#pragma once

#include "curve.hpp"

namespace grasptrack {

// atan2 at a third of its price where the angle is small, as it is nearly everywhere on an outline: the series of
// atan, to the last bit or two for a tangent below 1/4.
inline double turning(double y, double x) {
    if (!(std::fabs(y) < 0.25 * x)) return std::atan2(y, x);
    const double t = y / x, q = t * t;
    double sum = 1.0 / 25;
    sum = 1.0 / 23 - q * sum;
    sum = 1.0 / 21 - q * sum;
    sum = 1.0 / 19 - q * sum;
    sum = 1.0 / 17 - q * sum;
    sum = 1.0 / 15 - q * sum;
    sum = 1.0 / 13 - q * sum;
    sum = 1.0 / 11 - q * sum;
    sum = 1.0 / 9 - q * sum;
    sum = 1.0 / 7 - q * sum;
    sum = 1.0 / 5 - q * sum;
    sum = 1.0 / 3 - q * sum;
    return t - t * q * sum;
}

inline void curvature(Points points, double step, double *out) {
    const Integral curve(points);
    const double whole = curve.length_of_curve();
    if (!(step > 0 && step <= whole / 4))
        throw std::invalid_argument("step must be above 0 and at most a quarter of the length " + number(whole) +
                                    ", not " + number(step));
    Integral::Reader read_a(curve, -1.5 * step), read_b(curve, -0.5 * step), read_c(curve, 0), read_d(curve, 0);
    for (std::size_t i = 0; i < points.size; ++i) {
        const double s = curve.arc(i);
        const Vec a = read_a.integral(s - 1.5 * step), b = read_b.integral(s - 0.5 * step);
        const Vec c = read_c.integral(s + 0.5 * step), d = read_d.integral(s + 1.5 * step);
        // Chords of box means, times step.
        const Vec before = c - 2.0 * b + a, after = d - 2.0 * c + b;
        out[i] = turning(cross(before, after), dot(before, after)) / step;
    }
}

inline void resample(Points points, std::size_t count, double smooth, Vec *out) {
    const Integral curve(points);
    const double whole = curve.length_of_curve();
    if (!(smooth >= 0 && smooth <= whole))
        throw std::invalid_argument("smooth must be between 0 and the length " + number(whole) + ", not " +
                                    number(smooth));
    const double spacing = whole / static_cast<double>(count);
    if (smooth <= 1e-9 * whole) {
        Integral::Reader read(curve, 0);
        for (std::size_t j = 0; j < count; ++j) out[j] = curve.origin() + read.point(static_cast<double>(j) * spacing);
        return;
    }
    Integral::Reader read_low(curve, -0.5 * smooth), read_high(curve, 0);
    for (std::size_t j = 0; j < count; ++j) {
        const double s = static_cast<double>(j) * spacing;
        const Vec high = read_high.integral(s + 0.5 * smooth), low = read_low.integral(s - 0.5 * smooth);
        out[j] = curve.origin() + (1 / smooth) * (high - low);
    }
}

inline void blend_normals(Points points, Vec *out) {
    const std::size_t n = points.size;
    for (std::size_t i = 0; i < n; ++i) {
        const Vec following = points[i + 1 < n ? i + 1 : 0];
        Vec chord = following - points[i > 0 ? i - 1 : n - 1];
        if (chord.x == 0 && chord.y == 0) chord = following - points[i];
        const double size = length(chord);
        out[i] = size > 0 ? Vec{chord.y / size, -chord.x / size} : Vec{0, 0};
    }
}

}  // namespace grasptrack
