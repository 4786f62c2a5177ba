// SPDX-License-Identifier: Apache-2.0
// Whether a closed contour crosses itself, exactly.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "points.hpp"

namespace grasptrack {

// Sign of the area of a triangle, exact: by rounded numbers where these suffice, else by a sum that leaves nothing out
// (J. R. Shewchuk, Adaptive precision floating-point arithmetic, 1997).
inline int turn(Vec a, Vec b, Vec c) {
    constexpr double rounding = 3.3306690738754716e-16;
    const double left = (a.x - c.x) * (b.y - c.y), right = (a.y - c.y) * (b.x - c.x), rough = left - right;
    if (std::fabs(rough) > rounding * (std::fabs(left) + std::fabs(right))) return rough > 0 ? 1 : -1;
    const double factors[6][2] = {{a.x, b.y}, {-a.y, b.x}, {b.x, c.y}, {-b.y, c.x}, {c.x, a.y}, {-c.y, a.x}};
    double parts[12];
    int count = 0;
    const auto add = [&](double value) {
        int kept = 0;
        for (int i = 0; i < count; ++i) {  // a sum of two, and what rounding took from it
            const double sum = value + parts[i], back = sum - value;
            const double rest = (value - (sum - back)) + (parts[i] - back);
            if (rest != 0) parts[kept++] = rest;
            value = sum;
        }
        if (value != 0) parts[kept++] = value;
        count = kept;
    };
    for (const auto &f : factors) {
        const double product = f[0] * f[1];
        add(std::fma(f[0], f[1], -product));
        add(product);
    }
    return count == 0 ? 0 : parts[count - 1] > 0 ? 1 : -1;
}

// Whether x lies within the angle at b that opens to the left of a ... b ... c: 1, on one of its sides 0, outside -1.
inline int within_angle(Vec a, Vec b, Vec c, Vec x) {
    const int from_a = turn(b, a, x), from_c = turn(b, c, x), bend = turn(b, c, a);
    const auto ahead = [&](Vec side) { return dot(side - b, x - b) > 0; };
    if ((from_a == 0 && ahead(a)) || (from_c == 0 && ahead(c))) return 0;
    if (bend > 0) return from_c > 0 && from_a < 0 ? 1 : -1;
    if (bend < 0) return from_c > 0 || from_a < 0 ? 1 : -1;
    return dot(a - b, c - b) > 0 ? 0 : from_c > 0 ? 1 : -1;  // there and back again, or straight on
}

// Sides i, from point i to the next, and j that cross; {-1, -1} where none do. Two that touch do not cross, nor do those that
// lie on each other.
inline std::pair<std::int64_t, std::int64_t> first_crossing(Points points) {
    const std::size_t n = points.size;
    const auto at = [&](std::size_t i) { return points[i < n ? i : i - n]; };
    const auto cross_at = [&](std::size_t i, std::size_t j) {
        const Vec a = points[i], b = at(i + 1), c = points[j], d = at(j + 1);
        const int ci = turn(a, b, c), di = turn(a, b, d), aj = turn(c, d, a), bj = turn(c, d, b);
        if (ci * di < 0 && aj * bj < 0) return true;
        const auto between = [](Vec p, Vec q, Vec x) { return dot(p - x, q - x) < 0; };
        // each point belongs to the side that it ends
        if (b.x == d.x && b.y == d.y) {
            const int before = within_angle(a, b, at(i + 2), c), after = within_angle(a, b, at(i + 2), at(j + 2));
            return before * after < 0;
        }
        if (bj == 0 && between(c, d, b) && aj * turn(c, d, at(i + 2)) < 0) return true;
        return di == 0 && between(a, b, d) && ci * turn(a, b, at(j + 2)) < 0;
    };
    struct Span {
        double left, right, top, bottom;
        std::size_t side;
    };
    std::vector<Span> spans(n);
    for (std::size_t i = 0; i < n; ++i) {
        const Vec a = points[i], b = at(i + 1);
        spans[i] = {std::min(a.x, b.x), std::max(a.x, b.x), std::min(a.y, b.y), std::max(a.y, b.y), i};
    }
    std::sort(spans.begin(), spans.end(), [](const Span &a, const Span &b) { return a.left < b.left || (a.left == b.left && a.side < b.side); });
    for (std::size_t k = 0; k < n; ++k)
        for (std::size_t l = k + 1; l < n && spans[l].left <= spans[k].right; ++l) {
            if (spans[l].top > spans[k].bottom || spans[l].bottom < spans[k].top) continue;
            const std::size_t i = std::min(spans[k].side, spans[l].side), j = std::max(spans[k].side, spans[l].side);
            if (j - i <= 1 || j - i == n - 1) continue;  // neighbours meet in their point
            if (cross_at(i, j)) return {static_cast<std::int64_t>(i), static_cast<std::int64_t>(j)};
        }
    return {-1, -1};
}

}  // namespace grasptrack
