// SPDX-License-Identifier: Apache-2.0
// Where a straight line meets the contours, and the places nearest to points.
#pragma once

#include <algorithm>
#include <limits>

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
    Nearby(const Outline &outline, Vec first, Vec second)
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

    void search(std::size_t c) {
        const Points points = outline_.contour(c);
        Vec start = points[0];
        for (std::size_t i = 0; i < points.size; ++i) {
            const Vec end = points[i + 1 < points.size ? i + 1 : 0], side = end - start;
            const double square = dot(side, side);
            // Who is within d of a segment is within d + its length of its start: with squares, twice their sum.
            const Pair near = squared_distance(start), limit = both(2) * (best_ + both(square));
            const bool far[] = {near[0] > limit[0], near[1] > limit[1]};
            if (!(far[0] & far[1]))
                for (int q = 0; q < 2; ++q) improve(q, c, i, queries_[q] - start, side, square);
            start = end;
        }
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

inline void project_to_contour(const Outline &outline, Points queries, Projected *out) {
    std::size_t k = 0;
    for (; k + 1 < queries.size; k += 2) {
        const Nearby nearby(outline, queries[k], queries[k + 1]);
        out[k] = nearby.found(0);
        out[k + 1] = nearby.found(1);
    }
    if (k < queries.size) out[k] = Nearby(outline, queries[k], queries[k]).found(0);
}

}  // namespace grasptrack
