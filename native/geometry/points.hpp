// SPDX-License-Identifier: Apache-2.0
// Points, and contours as they lie in memory.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace grasptrack {

struct Vec {
    double x, y;
};

inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y}; }
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y}; }
inline Vec operator-(Vec a) { return {-a.x, -a.y}; }
inline Vec operator*(double s, Vec a) { return {s * a.x, s * a.y}; }
inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y; }
inline double cross(Vec a, Vec b) { return a.x * b.y - a.y * b.x; }
inline double length(Vec a) { return std::sqrt(dot(a, a)); }

// Two doubles in one register, added and multiplied lane by lane.
#if defined(__GNUC__)
typedef double Pair __attribute__((vector_size(16)));
#else
struct Pair {
    double lane[2];
    double &operator[](std::size_t i) { return lane[i]; }
    double operator[](std::size_t i) const { return lane[i]; }
};
inline Pair operator+(Pair a, Pair b) { return {a[0] + b[0], a[1] + b[1]}; }
inline Pair operator-(Pair a, Pair b) { return {a[0] - b[0], a[1] - b[1]}; }
inline Pair operator*(Pair a, Pair b) { return {a[0] * b[0], a[1] * b[1]}; }
#endif

inline Pair pair(Vec a) { return Pair{a.x, a.y}; }
inline Pair both(double a) { return Pair{a, a}; }
inline double cross(Pair a, Pair b) { return a[0] * b[1] - a[1] * b[0]; }
inline double dot(Pair a, Pair b) { return a[0] * b[0] + a[1] * b[1]; }

// Array (n, 2) of doubles seen as points.
struct Points {
    const Vec *data;
    std::size_t size;
    const Vec &operator[](std::size_t i) const { return data[i]; }
};

// A concatenation of closed contours: contour c is points[offsets[c] .. offsets[c + 1]).
struct Outline {
    Points points;
    const std::int64_t *offsets;
    std::size_t contours;

    Points contour(std::size_t c) const {
        return {points.data + offsets[c], static_cast<std::size_t>(offsets[c + 1] - offsets[c])};
    }
};

// A place on an outline: segment i of a contour and the fraction of it.
struct Place {
    Points contour;
    std::size_t i;
    double fraction;

    std::size_t following() const { return i + 1 < contour.size ? i + 1 : 0; }
    Vec side() const { return contour[following()] - contour[i]; }
    Vec point() const { return contour[i] + fraction * side(); }
};

inline std::string number(double value) {
    std::string text = std::to_string(value);
    text.erase(text.find_last_not_of('0') + 1);
    if (!text.empty() && text.back() == '.') text.pop_back();
    return text;
}

inline Place find_place(const Outline &outline, double contour, double position) {
    // Negated comparisons, so that NaN is refused as well.
    if (!(contour >= 0 && contour < static_cast<double>(outline.contours)))
        throw std::invalid_argument("contour " + number(contour) + " is not one of " + std::to_string(outline.contours));
    const Points points = outline.contour(static_cast<std::size_t>(contour));
    const double n = static_cast<double>(points.size);
    if (!(position >= 0 && position <= n) || points.size == 0)
        throw std::invalid_argument("position " + number(position) + " is not on a contour of " +
                                    std::to_string(points.size) + " points");
    if (position == n) return {points, 0, 0.0};
    const auto i = static_cast<std::size_t>(position);
    return {points, i, position - static_cast<double>(i)};
}

}  // namespace grasptrack
