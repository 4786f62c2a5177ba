// SPDX-License-Identifier: Apache-2.0
// Where a straight line meets the contours, and the places nearest to points.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "../wide.hpp"
#include "points.hpp"

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

struct Projected {
    double contour, position, distance;
};

// The nearest places to two queries; both are held against a segment at once.
class Nearby {
  public:
    GRASPTRACK_WITHIN Nearby(const Outline &outline, Vec first, Vec second)
        : outline_(outline), queries_{first, second}, x_{first.x, second.x}, y_{first.y, second.y} {
        // Some vertices first, so that most segments are seen to be too far at a glance.
        for (std::size_t i = 0; i < outline.points.size; i += std::max<std::size_t>(8, outline.points.size / 64)) {
            const Pair near = squared_distance(outline.points[i]);
            for (int q = 0; q < 2; ++q) best_[q] = near[q] < best_[q] ? near[q] : best_[q];
        }
        best_ = best_ * both(1 + 1e-9) + both(1e-300);  // none of them is the answer yet
        for (std::size_t c = 0; c < outline.contours; ++c) search(c);
    }

    Projected found(int q) const {
        const Points points = outline_.contour(contour_[q]);
        const std::size_t i = at_[q];
        const Vec side = points[i + 1 < points.size ? i + 1 : 0] - points[i], gap = queries_[q] - points[i];
        const double square = dot(side, side);
        double f = square > 0 ? dot(gap, side) / square : 0.0;
        f = f < 0 ? 0.0 : (f > 1 ? 1.0 : f);
        const double place = static_cast<double>(i) + f;
        return {static_cast<double>(contour_[q]), place < static_cast<double>(points.size) ? place : 0.0,
                length(gap - f * side)};
    }

  private:
    Pair squared_distance(Vec p) const {
        const Pair dx = x_ - both(p.x), dy = y_ - both(p.y);
        return dx * dx + dy * dy;
    }

    GRASPTRACK_WITHIN void search(std::size_t c) {
        const Points points = outline_.contour(c);
        constexpr std::size_t most = 32;
        std::int64_t near[most];
        std::size_t first = 0;
        for (; first + most < points.size; first += most) {
            if (!look_at(points.data + first, near)) continue;
            for (std::size_t i = 0; i < most; ++i)
                if (near[i]) improve(c, first + i, points[first + i + 1]);
        }
        for (; first < points.size; ++first) improve(c, first, points[first + 1 < points.size ? first + 1 : 0]);
    }

    // Which of so many segments may be nearer to a query than all before.
    template <std::size_t N> GRASPTRACK_WITHIN bool look_at(const Vec *p, std::int64_t (&near)[N]) const {
        const double x0 = x_[0], x1 = x_[1], y0 = y_[0], y1 = y_[1], best0 = best_[0], best1 = best_[1];
        std::int64_t any = 0;
        for (std::size_t i = 0; i < N; ++i) {
            const double dx = p[i + 1].x - p[i].x, dy = p[i + 1].y - p[i].y, square = dx * dx + dy * dy;
            const double ax = x0 - p[i].x, ay = y0 - p[i].y, bx = x1 - p[i].x, by = y1 - p[i].y;
            // Who is within d of a segment is within d + its length of its start: with squares, twice their sum.
            near[i] = !(ax * ax + ay * ay > 2 * (best0 + square)) | !(bx * bx + by * by > 2 * (best1 + square));
            any |= near[i];
        }
        return any != 0;
    }

    void improve(std::size_t c, std::size_t i, Vec end) {
        const Vec start = outline_.contour(c)[i], side = end - start;
        for (int q = 0; q < 2; ++q) improve(q, c, i, queries_[q] - start, side, dot(side, side));
    }

    void improve(int q, std::size_t c, std::size_t i, Vec gap, Vec side, double square) {
        const double along = dot(gap, side), across = cross(gap, side);
        // Beyond its end, a segment leaves the answer to the next one.
        if (along > 0 && along >= square) return;
        const double distance = along > 0 ? across * across / square : dot(gap, gap);
        if (distance < best_[q]) best_[q] = distance, at_[q] = i, contour_[q] = c;
    }

    const Outline &outline_;
    Vec queries_[2];
    Pair x_, y_, best_ = both(std::numeric_limits<double>::infinity());
    std::size_t at_[2] = {0, 0}, contour_[2] = {0, 0};
};

GRASPTRACK_WIDE inline void project_to_contour(const Outline &outline, Points queries, Projected *out) {
    std::size_t k = 0;
    for (; k + 1 < queries.size; k += 2) {
        const Nearby nearby(outline, queries[k], queries[k + 1]);
        out[k] = nearby.found(0);
        out[k + 1] = nearby.found(1);
    }
    if (k < queries.size) out[k] = Nearby(outline, queries[k], queries[k]).found(0);
}

}  // namespace grasptrack
