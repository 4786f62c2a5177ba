// SPDX-License-Identifier: Apache-2.0
// Room for one call's intermediate results, kept from call to call.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <utility>

#include "points.hpp"

namespace grasptrack {

// An array that is not initialised. Its memory goes back to the thread and not to the system, which would have to clear
// every page of it again for the next call: with long outlines that costs more than the arithmetic.
template <typename Value> class Scratch {
    struct Room {
        std::unique_ptr<Value[]> values;
        std::size_t size = 0;
    };

  public:
    explicit Scratch(std::size_t size) : room_(std::exchange(kept(), Room{})) {
        if (room_.size < size) room_ = {std::unique_ptr<Value[]>(new Value[size]), size};
    }
    ~Scratch() { kept() = std::move(room_); }
    Scratch(const Scratch &) = delete;
    Scratch &operator=(const Scratch &) = delete;

    Value *get() const { return room_.values.get(); }
    Value &operator[](std::size_t i) const { return room_.values[i]; }

  private:
    static Room &kept() {
        thread_local Room room;
        return room;
    }

    Room room_;
};

// One closed contour as a curve of its arc length.

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
        // Rounded, the last may be no farther than what is read, and of a contour without length it is not: who reads stops there.
        knot[n + after_].arc = std::numeric_limits<double>::infinity();
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

// Curvature, resampling and vertex normals of one closed contour.

// scale * atan2 of many values at once. Up to a turn of 65 degrees, that is nearly everywhere on an outline, it is
// twice the angle of half the turn by the rational function of Cephes' atan (S. Moshier, 1984-1995); else the library's.
inline void turnings(const double *y, const double *x, std::size_t count, double scale, double *out) {
    constexpr double steep = 2.14;
    for (std::size_t i = 0; i < count; ++i) {  // no branches: the compiler takes two at a time
        const double t = y[i] / (x[i] + std::sqrt(x[i] * x[i] + y[i] * y[i])), z = t * t;
        double p = -8.750608600031904122785e-1;
        p = p * z - 1.615753718733365076637e1;
        p = p * z - 7.500855792314704667340e1;
        p = p * z - 1.228866684490136173410e2;
        p = p * z - 6.485021904942025371773e1;
        double q = z + 2.485846490142306297962e1;
        q = q * z + 1.650270098316988542046e2;
        q = q * z + 4.328810604912902668951e2;
        q = q * z + 4.853903996359136964868e2;
        q = q * z + 1.945506571482613964425e2;
        out[i] = 2 * scale * (t + t * (z * p / q));
    }
    for (std::size_t i = 0; i < count; ++i)
        if (!(std::fabs(y[i]) < steep * x[i])) out[i] = scale * std::atan2(y[i], x[i]);
}

// Curvature times `scale`.
inline void curvature(Points points, const double *arc, double step, double scale, double *out) {
    const std::size_t n = points.size;
    if (!(step > 0 && step <= arc[n] / 4))
        throw std::invalid_argument("step must be above 0 and at most a quarter of the length " + number(arc[n]) +
                                    ", not " + number(step));
    const Integral curve(points, arc, 1.5 * step);
    const Scratch<double> parts(2 * n);
    double *y = parts.get(), *x = y + n;
    Integral::Reader read_a(curve), read_b(curve), read_c(curve), read_d(curve);
    for (std::size_t i = 0; i < n; ++i) {
        const double s = arc[i];
        const Pair a = read_a.integral(s - 1.5 * step), b = read_b.integral(s - 0.5 * step);
        const Pair c = read_c.integral(s + 0.5 * step), d = read_d.integral(s + 1.5 * step);
        // Chords of box means, times step.
        const Pair middle = c - b, before = middle - (b - a), after = (d - c) - middle;
        y[i] = cross(before, after);
        x[i] = dot(before, after);
    }
    turnings(y, x, n, scale / step, out);
}

inline void curvature(Points points, double step, double *out) {
    const Scratch<double> arc(points.size + 1);
    arc_length(points, arc.get());
    curvature(points, arc.get(), step, 1.0, out);
}

// Smoothing and curvature refer to the length `whole`, or to the contour's own where it is 0.
inline void curvature_vector(Points points, const bool *clipped, double smoothing, double whole, double *arc, double *out) {
    arc_length(points, arc);
    const std::size_t n = points.size;
    const double scale = whole > 0 ? whole : arc[n], step = smoothing * scale;
    curvature(points, arc, step, scale, out);
    if (!clipped) return;
    const double reach = std::ceil(1.5 * step / (arc[n] / static_cast<double>(n)));
    // Counted from the last clipped point, once along the contour and once back.
    for (int way = 0; way < 2; ++way) {
        double since = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < 2 * n; ++k) {
            const std::size_t i = way == 0 ? k % n : n - 1 - k % n;
            since = clipped[i] ? 0 : since + 1;
            if (since <= reach) out[i] = std::numeric_limits<double>::quiet_NaN();
        }
    }
}

inline void resample(Points points, std::size_t count, double smooth, Vec *out) {
    const Scratch<double> arc(points.size + 1);
    arc_length(points, arc.get());
    const double whole = arc[points.size];
    if (!(whole > 0)) throw std::invalid_argument("a contour without length has no equal steps");
    if (!(smooth >= 0 && smooth <= whole))
        throw std::invalid_argument("smooth must be between 0 and the length " + number(whole) + ", not " +
                                    number(smooth));
    const double spacing = whole / static_cast<double>(count);
    const Integral curve(points, arc.get(), 0.5 * smooth);
    if (smooth <= 1e-7 * whole) {
        Integral::Reader read(curve);
        for (std::size_t j = 0; j < count; ++j) out[j] = curve.origin() + read.point(static_cast<double>(j) * spacing);
        return;
    }
    Integral::Reader read_low(curve), read_high(curve);
    for (std::size_t j = 0; j < count; ++j) {
        const double s = static_cast<double>(j) * spacing;
        const Pair sum = read_high.integral(s + 0.5 * smooth) - read_low.integral(s - 0.5 * smooth);
        out[j] = curve.origin() + (1 / smooth) * Vec{sum[0], sum[1]};
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
