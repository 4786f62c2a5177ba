// SPDX-License-Identifier: Apache-2.0
// Grasp-line coordinates (Sections III-B and IV-B).
#pragma once

#include "../geometry/moments.hpp"
#include "../geometry/places.hpp"

namespace grasptrack {

// The coordinates of a grasp line, and what they are measured in.
struct GraspLine {
    double d_c, alpha_m, d_1, d_2;
};

struct DescribedLine {
    GraspLine line;
    double sine, opening;
};

inline DescribedLine grasp_line(const Moments &frame, Vec first, Vec second) {
    const double opening = length(second - first), root = std::sqrt(frame.area);
    const Vec u = (1 / opening) * (second - first), e{std::cos(frame.angle), std::sin(frame.angle)};
    const Vec centroid = Vec{frame.x, frame.y} - first;
    const double sine = cross(e, u), cosine = dot(e, u), along = dot(centroid, u), left = cross(centroid, u);
    // Along the line, I_min passes the centroid's foot by left * cot(alpha).
    const double meets = along - left * cosine / sine;
    return {{left / root, std::atan2(sine, cosine), -meets / root, (opening - meets) / root}, sine, opening};
}

struct LineReference {
    double t30, t21, t12, t03, area, cx, cy, theta;
};

struct CarriedLine {
    double residual;
    bool told;
};

// contacts is (2, 2), H (3, 3). `ahead` is where I_min points as a prediction has it, or (0, 0).
inline CarriedLine carry_grasp_line(const Outline &outline, const Moments &frame, const GraspLine &line,
                                    const LineReference &reference, Vec ahead, double least_skewness, Vec *contacts,
                                    double *H) {
    constexpr double pi = 3.14159265358979323846;
    double theta = frame.angle;
    bool told = true;
    if (ahead.x != 0 || ahead.y != 0) {
        if (!(dot(ahead, {std::cos(theta), std::sin(theta)}) > 0)) theta += pi;
    } else {
        // A half turn changes the sign of all four moments.
        const LineReference &r = reference;
        const double agreement = r.t30 * frame.t30 + r.t21 * frame.t21 + r.t12 * frame.t12 + r.t03 * frame.t03;
        const double before = std::sqrt(r.t30 * r.t30 + r.t21 * r.t21 + r.t12 * r.t12 + r.t03 * r.t03);
        const double now = std::sqrt(frame.t30 * frame.t30 + frame.t21 * frame.t21 + frame.t12 * frame.t12 +
                                     frame.t03 * frame.t03);
        told = before >= least_skewness && before * now >= least_skewness * least_skewness &&
               std::fabs(agreement) >= 0.5 * before * now;
        if (told && !(agreement > 0)) theta += pi;
    }
    const double root = std::sqrt(frame.area);
    const Vec centroid{frame.x, frame.y}, e{std::cos(theta), std::sin(theta)};
    const double cosine = std::cos(line.alpha_m), sine = std::sin(line.alpha_m);
    const Vec u{e.x * cosine - e.y * sine, e.y * cosine + e.x * sine};
    // From the centroid along I_min to where the line of that d_c crosses it.
    const Vec q = centroid + (-line.d_c * root / sine) * e;
    Nearest a{line.d_1 * root}, b{line.d_2 * root};
    for_each_crossing(outline, {q, u}, [&](std::size_t, double, double t) { a.offer(t), b.offer(t); });
    contacts[0] = q + a.t * u;
    contacts[1] = q + b.t * u;
    const double scale = root / std::sqrt(reference.area), turn = theta - reference.theta;
    const double c = scale * std::cos(turn), s = scale * std::sin(turn);
    const double rows[] = {c, -s, centroid.x - c * reference.cx + s * reference.cy,
                           s, c,  centroid.y - s * reference.cx - c * reference.cy,
                           0, 0,  1};
    std::copy(rows, rows + 9, H);
    if (a.t == b.t) return {std::numeric_limits<double>::infinity(), told};
    return {std::isnan(a.t) ? a.t : std::max(a.gap, b.gap), told};
}

}  // namespace grasptrack
