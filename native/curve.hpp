// SPDX-License-Identifier: Apache-2.0
// One closed contour as a curve of its arc length.
#pragma once

#include <vector>

#include "geometry.hpp"

namespace grasptrack {

inline void arc_length(Points points, double *out) {
    double s = out[0] = 0.0;
    for (std::size_t i = 0; i < points.size; ++i) {
        s += length(points[i + 1 < points.size ? i + 1 : 0] - points[i]);
        out[i + 1] = s;
    }
}

// F(s), the integral of the curve from 0 to s relative to its first point, exact on the polygon.
class Integral {
    struct Knot {
        Vec point, slope, prefix;
        double arc;
    };

  public:
    explicit Integral(Points points) : knots_(points.size + 1), size_(points.size) {
        origin_ = points[0];
        Knot here{};
        for (std::size_t i = 0; i < size_; ++i) {
            const Vec side = points[i + 1 < size_ ? i + 1 : 0] - points[i];
            const double span = length(side);
            here.point = points[i] - origin_;
            here.slope = span > 0 ? (1 / span) * side : Vec{0, 0};
            knots_[i] = here;
            here.prefix = here.prefix + span * (here.point + 0.5 * side);
            here.arc += span;
        }
        here.point = here.slope = {0, 0};
        knots_[size_] = here;
    }

    double length_of_curve() const { return knots_[size_].arc; }
    double arc(std::size_t i) const { return knots_[i].arc; }
    Vec origin() const { return origin_; }

    // Reads the curve at values of s that never fall, one segment after the other.
    class Reader {
      public:
        Reader(const Integral &curve, double s)
            : knots_(curve.knots_.data()), size_(curve.size_), laps_(std::floor(s / curve.length_of_curve())) {
            base_ = laps_ * knots_[size_].arc;
        }

        Vec integral(double s) {
            const double d = advance(s);
            const Knot &k = knots_[i_];
            return laps_ * knots_[size_].prefix + k.prefix + d * (k.point + (0.5 * d) * k.slope);
        }

        Vec point(double s) {
            const double d = advance(s);
            return knots_[i_].point + d * knots_[i_].slope;
        }

      private:
        double advance(double s) {
            double rest = s - base_;
            while (rest >= knots_[i_ + 1].arc) {
                if (++i_ == size_) {
                    i_ = 0;
                    laps_ += 1;
                    base_ = laps_ * knots_[size_].arc;
                    rest = s - base_;
                }
            }
            return rest - knots_[i_].arc;
        }

        const Knot *knots_;
        std::size_t size_;
        double laps_, base_;
        std::size_t i_ = 0;
    };

  private:
    std::vector<Knot> knots_;
    std::size_t size_;
    Vec origin_{};
};

}  // namespace grasptrack
