// SPDX-License-Identifier: Apache-2.0
// Where a straight line meets the contours, and the places nearest to points.
#pragma once

#include <limits>

#include "geometry.hpp"

namespace grasptrack {

struct Line {
    Vec at, along;
    double t(Vec p) const { return dot(p - at, along); }
    double side(Vec p) const { return cross(along, p - at); }
};

// Calls found(contour, position, t) at each crossing, in the order of the contours.
template <typename Found> void for_each_crossing(const Outline &outline, const Line &line, Found found) {
    for (std::size_t c = 0; c < outline.contours; ++c) {
        const Points points = outline.contour(c);
        const std::size_t n = points.size;
        // Sides are compared between vertices off the line only, so that touching is not crossing.
        std::size_t first = 0;
        while (first < n && line.side(points[first]) == 0) ++first;
        if (first == n) continue;
        std::size_t i = first;
        double side_i = line.side(points[i]);
        for (std::size_t step = 1, j = first; step <= n; ++step) {
            j = j + 1 < n ? j + 1 : 0;
            const double side_j = line.side(points[j]);
            if (side_j == 0) continue;
            if ((side_i > 0) != (side_j > 0)) {
                const std::size_t next = i + 1 < n ? i + 1 : 0, last = j > 0 ? j - 1 : n - 1;
                if (next == j) {
                    const double f = side_i / (side_i - side_j), ti = line.t(points[i]);
                    const double place = static_cast<double>(i) + f;
                    found(c, place < static_cast<double>(n) ? place : 0.0, ti + f * (line.t(points[j]) - ti));
                } else {
                    const double t_next = line.t(points[next]), t_last = line.t(points[last]);
                    if (t_next <= t_last)
                        found(c, static_cast<double>(next), t_next);
                    else
                        found(c, static_cast<double>(last), t_last);
                }
            }
            i = j;
            side_i = side_j;
        }
    }
}

struct Nearest {
    double wanted, t = std::numeric_limits<double>::quiet_NaN(), gap = std::numeric_limits<double>::infinity();

    void offer(double candidate) {
        const double distance = std::fabs(candidate - wanted);
        if (distance < gap || (distance == gap && candidate < t)) t = candidate, gap = distance;
    }
};

struct Located {
    double contour, position, distance;
};

inline Located locate(const Outline &outline, Vec query) {
    double best = std::numeric_limits<double>::infinity();
    std::size_t at = 0, contour = 0;
    for (std::size_t c = 0; c < outline.contours; ++c) {
        const Points points = outline.contour(c);
        for (std::size_t i = 0; i < points.size; ++i) {
            const Vec side = points[i + 1 < points.size ? i + 1 : 0] - points[i];
            const Vec gap = query - points[i];
            const double along = dot(gap, side), square = dot(side, side);
            // Beyond its end, a segment leaves the answer to the next one. No division until something is nearer.
            if (along <= 0) {
                const double distance = dot(gap, gap);
                if (distance < best) best = distance, at = i, contour = c;
            } else if (along < square) {
                const double across = cross(gap, side);
                if (across * across < best * square) best = across * across / square, at = i, contour = c;
            }
        }
    }
    const Points points = outline.contour(contour);
    const Vec side = points[at + 1 < points.size ? at + 1 : 0] - points[at], gap = query - points[at];
    const double square = dot(side, side);
    double f = square > 0 ? dot(gap, side) / square : 0.0;
    f = f < 0 ? 0.0 : (f > 1 ? 1.0 : f);
    const double place = static_cast<double>(at) + f;
    return {static_cast<double>(contour), place < static_cast<double>(points.size) ? place : 0.0, length(gap - f * side)};
}

}  // namespace grasptrack
