// SPDX-License-Identifier: Apache-2.0
// Normal and flatness of an outline over the width of a finger.
#pragma once

#include <algorithm>

#include "../geometry/points.hpp"

namespace grasptrack {

struct ContactFrame {
    double nx, ny, flatness, used;
};

// Integrals over the stretch of a contour about a place, in the frame of the segment at the place: a straight stretch
// then has exactly no variance across.
struct Stretch {
    Place place;
    Vec tangent, origin;
    double total = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    Vec ends[2] = {{0, 0}, {0, 0}};

    explicit Stretch(const Place &where) : place(where), origin(where.point()) {
        const Vec side = where.side();
        const double size = length(side);
        tangent = size > 0 ? (1 / size) * side : Vec{1, 0};
    }

    Vec local(Vec p) const {
        const Vec d = p - origin;
        return {dot(tangent, d), cross(tangent, d)};
    }

    void add(Vec p, Vec q, double span) {
        total += span;
        x += span * (p.x + q.x) / 2;
        y += span * (p.y + q.y) / 2;
        xx += span * (p.x * p.x + p.x * q.x + q.x * q.x) / 3;
        yy += span * (p.y * p.y + p.y * q.y + q.y * q.y) / 3;
        xy += span * (2 * (p.x * p.y + q.x * q.y) + p.x * q.y + q.x * p.y) / 6;
    }

    // Walks `half` px each way; returns how many further segments were entered.
    std::size_t walk(double half) {
        const std::size_t n = place.contour.size;
        std::size_t entered = 0;
        for (int way = 0; way < 2; ++way) {
            double left = half;
            Vec here{0, 0};
            std::size_t j = way == 0 ? place.following() : place.i;
            for (std::size_t step = 0; step <= n; ++step) {
                Vec there = local(place.contour[j]);
                double span = length(there - here);
                if (span >= left) {
                    there = span > 0 ? here + (left / span) * (there - here) : here;
                    span = left;
                }
                add(here, there, span);
                left -= span;
                here = there;
                if (!(left > 0)) break;
                ++entered;
                if (way == 0)
                    j = j + 1 < n ? j + 1 : 0;
                else
                    j = j > 0 ? j - 1 : n - 1;
            }
            ends[way] = here;
        }
        return entered;
    }
};

inline double contour_length(Points points) {
    double sum = 0;
    for (std::size_t i = 0; i < points.size; ++i) sum += length(points[i + 1 < points.size ? i + 1 : 0] - points[i]);
    return sum;
}

inline ContactFrame contact_frame(const Place &place, double width) {
    constexpr double round = 1e-12;
    Stretch stretch(place);
    double used = width;
    // Only a walk that may have met itself needs the whole length.
    bool whole = false;
    if (stretch.walk(width / 2) >= place.contour.size) {
        const double all = contour_length(place.contour);
        used = std::min(width, all);
        stretch = Stretch(place);
        stretch.walk(used / 2);
        whole = used >= all * (1 - 1e-12);
    }
    const double total = stretch.total;
    if (!(total > 0)) throw std::invalid_argument("a contour without length has no normal");
    const double mx = stretch.x / total, my = stretch.y / total;
    const double a = stretch.xx / total - mx * mx, c = stretch.yy / total - my * my;
    const double b = stretch.xy / total - mx * my;
    Vec chord = stretch.ends[0] - stretch.ends[1];
    if (whole || length(chord) <= round * total) chord = {1, 0};
    const double radius = std::sqrt((a - c) * (a - c) / 4 + b * b), major = (a + c) / 2 + radius;
    Vec e;
    if (2 * radius <= round * (a + c)) {
        e = (1 / length(chord)) * chord;
    } else {
        const double angle = 0.5 * std::atan2(b, (a - c) / 2);
        e = {std::cos(angle), std::sin(angle)};
        const double lean = dot(e, chord);
        // Across the chord neither sign is better: the segment at the place decides.
        if (lean < -round * total || (std::fabs(lean) <= round * total && e.x < 0)) e = -e;
    }
    const double minor = std::max(a * c - b * b, 0.0) / major;
    const Vec t = stretch.tangent, g{e.x * t.x - e.y * t.y, e.x * t.y + e.y * t.x};
    return {-g.y, g.x, std::sqrt(minor) / width, used / width};
}

}  // namespace grasptrack
