// SPDX-License-Identifier: Apache-2.0
// One closed contour as a curve of its arc length.
#pragma once

#include "geometry.hpp"
#include "scratch.hpp"

namespace grasptrack {

inline void arc_length(Points points, double *out) {
    const std::size_t last = points.size - 1;
    out[0] = 0.0;
    for (std::size_t i = 0; i < last; ++i) {  // the sides first, without a test for the end: two roots at a time
        const double dx = points.data[i + 1].x - points.data[i].x, dy = points.data[i + 1].y - points.data[i].y;
        out[i + 1] = std::sqrt(dx * dx + dy * dy);
    }
    out[last + 1] = length(points[0] - points[last]);
    for (std::size_t i = 0; i < points.size; ++i) out[i + 1] += out[i];
}

// F(s), the integral of the curve from 0 to s relative to its first point, exact on the polygon. It can be read from
// -margin to the length + margin, for a margin in px below the length.
class Integral {
    struct Knot {
        Pair point, half_slope, prefix;
        double arc;
    };

  public:
    Integral(Points points, const double *arc, double margin)
        : before_(knots_before(points.size, arc, margin)), after_(knots_after(points.size, arc, margin)),
          room_(before_ + points.size + after_ + 1), origin_(points[0]) {
        const std::size_t n = points.size;
        Knot *knot = room_.get() + before_;
        const Pair origin = pair(origin_);
        Pair here = both(0), whole = both(0);
        for (std::size_t i = 0; i < n; ++i) {
            const Pair next = pair(points[i + 1 < n ? i + 1 : 0]) - origin, half = both(0.5) * (next - here);
            const double span = arc[i + 1] - arc[i];
            knot[i] = {here, both(span > 0 ? 1 / span : 0) * half, whole, arc[i]};
            whole = whole + both(span) * (here + half);
            here = next;
        }
        for (std::size_t i = 1; i <= before_; ++i) {
            knot[-static_cast<std::ptrdiff_t>(i)] = knot[n - i];
            knot[-static_cast<std::ptrdiff_t>(i)].prefix = knot[n - i].prefix - whole;
            knot[-static_cast<std::ptrdiff_t>(i)].arc = arc[n - i] - arc[n];
        }
        for (std::size_t i = 0; i <= after_; ++i) {
            knot[n + i] = knot[i];
            knot[n + i].prefix = knot[i].prefix + whole;
            knot[n + i].arc = arc[n] + arc[i];
        }
    }

    Vec origin() const { return origin_; }

    // Reads the curve at values of s that never fall, one segment after the other.
    class Reader {
      public:
        explicit Reader(const Integral &curve) : knot_(curve.room_.get()) {}

        Pair integral(double s) {
            const Pair d = both(advance(s));
            return knot_->prefix + d * (knot_->point + d * knot_->half_slope);
        }

        Vec point(double s) {
            const Pair d = both(2 * advance(s)), p = knot_->point + d * knot_->half_slope;
            return {p[0], p[1]};
        }

      private:
        double advance(double s) {
            while (s >= knot_[1].arc) ++knot_;
            return s - knot_->arc;
        }

        const Knot *knot_;
    };

  private:
    // How many sides of the lap before, and of the lap after, the margin reaches over.
    static std::size_t knots_before(std::size_t n, const double *arc, double margin) {
        std::size_t count = 0;
        while (count < n && arc[n] - arc[n - count] < margin) ++count;
        return count;
    }
    static std::size_t knots_after(std::size_t n, const double *arc, double margin) {
        std::size_t count = 1;
        while (count < n && arc[count] <= margin) ++count;
        return count;
    }

    std::size_t before_, after_;
    Scratch<Knot> room_;
    Vec origin_;
};

}  // namespace grasptrack
