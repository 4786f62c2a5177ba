// SPDX-License-Identifier: Apache-2.0
// What lies beside the outline where its edge is not seen: the object's own inside and the background outside, something
// in front, or another shape - background where the object should be (a notch), the object where it should end (a tab).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "chain.hpp"
#include "edges.hpp"

namespace grasptrack::pose {

struct RegionNumbers {
    double spread;   // grey levels, of the object's own inside from what it was
    double unlikely;  // share of cells that nothing explains
    double power;    // of a sample's cells: how much of an independent measurement they are
};

struct Backdrop {  // grey levels just outside the visible outline near a sample
    double level = 0, spread = 0;
    bool known = false;
};

// Median and spread of the outside cells of the nearest visible samples on both sides.
inline Backdrop backdrop_at(std::size_t i, const std::vector<double> &visible, const std::vector<double> &outer,
                            const std::vector<double> &outside) {
    constexpr int near = 10, far = 120;  // samples that are asked, and how far away
    const auto n = static_cast<int>(visible.size());
    std::vector<double> levels;
    for (int side = -1; side <= 1; side += 2) {
        int found = 0;
        for (int step = 1; step <= std::min(far, n / 2) && found < near; ++step) {
            const auto j = static_cast<std::size_t>(((static_cast<int>(i) + side * step) % n + n) % n);
            if (visible[j] < 0.7) continue;
            ++found;
            for (std::size_t k = 0; k < region_cells; ++k) {
                const double v = outer[j * region_cells + k];
                if (outside[j * region_cells + k] > 0 && v == v) levels.push_back(v);
            }
        }
    }
    Backdrop out;
    if (levels.size() < 3 * region_cells) return out;
    const auto middle = levels.begin() + static_cast<std::ptrdiff_t>(levels.size() / 2);
    std::nth_element(levels.begin(), middle, levels.end());
    out.level = *middle;
    for (double &v : levels) v = std::abs(v - out.level);
    std::nth_element(levels.begin(), middle, levels.end());
    out.spread = 1.4826 * *middle + 3.0;
    out.known = true;
    return out;
}

inline double log_cell(double value, double level, double spread, double unlikely) {
    const double z = (value - level) / spread;
    return std::log((1 - unlikely) * std::exp(-0.5 * z * z) / (spread * 2.5066) + unlikely / 256.0);
}

// Log-likelihood ratio of "some stretch shows another shape" against "this shape, partly occluded".
inline double other_shape(const Target &target, const Pyramid &pyramid, const Homography &G, const std::vector<double> &visible,
                          Light light, const RegionNumbers &numbers, const States &share, double stay, double power,
                          std::vector<double> &other) {
    const std::size_t n = target.points.size();
    other.assign(n, 0.0);
    if (n == 0 || target.depth.size() != region_cells) return 0.0;
    std::vector<double> inner(n * region_cells), outer(n * region_cells);
    const Seen seen = look_through(pyramid, G, target.cx, target.cy, 1.0);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < region_cells; ++k)
            for (int side = 0; side < 2; ++side) {
                const double d = side == 0 ? -target.depth[k] : target.depth[k];
                const Point q = carried(seen.H, target.points[i].x + d * target.normals[i].x, target.points[i].y + d * target.normals[i].y);
                (side == 0 ? inner : outer)[i * region_cells + k] =
                    seen.level->holds(q.x, q.y, 1.0) ? seen.level->at(q.x, q.y) : std::numeric_limits<double>::quiet_NaN();
            }
    std::vector<double> same(n, 1.0), differs(n, 0.05);  // where the edge is seen there is nothing to explain
    bool any = false;
    for (std::size_t i = 0; i < n; ++i) {
        if (visible[i] > 0.5) continue;
        const Backdrop back = backdrop_at(i, visible, outer, target.outside);
        differs[i] = 1.0;
        if (!back.known) continue;
        double own_in = 0, back_in = 0, back_out = 0, own_out = 0, any_in = 0, any_out = 0;
        const double *edge = &target.inner[i * inner_pixels];
        double own = 0;
        for (int k = 0; k < inner_pixels; ++k) own += edge[k] / inner_pixels;
        own = light.gain * own + light.bias;
        for (std::size_t k = 0; k < region_cells; ++k) {
            const std::size_t q = i * region_cells + k;
            if (target.inside[q] == target.inside[q] && inner[q] == inner[q]) {
                own_in += log_cell(inner[q], light.gain * target.inside[q] + light.bias, numbers.spread, numbers.unlikely);
                back_in += log_cell(inner[q], back.level, back.spread, numbers.unlikely);
                any_in -= std::log(256.0);
            }
            if (target.outside[q] > 0 && outer[q] == outer[q]) {
                own_out += log_cell(outer[q], own, numbers.spread, numbers.unlikely);
                back_out += log_cell(outer[q], back.level, back.spread, numbers.unlikely);
                any_out -= std::log(256.0);
            }
        }
        const double occluded = any_in + any_out;
        const double p = numbers.power;
        same[i] = std::exp(std::clamp(p * (own_in + back_out - occluded), -20.0, 20.0));
        const double notch = back_in + back_out - occluded, tab = own_in + own_out - occluded;
        differs[i] = std::exp(std::clamp(p * std::max(notch, tab), -20.0, 20.0));
        any = true;
    }
    if (!any) return -1.0;
    const Chain with = stretches(same, differs, power, share, stay, true);
    States without = share;
    without[0] += without[2];
    without[2] = 1e-12;
    const Chain here = stretches(same, differs, power, without, stay, false);
    for (std::size_t i = 0; i < n; ++i) other[i] = with.posterior[i][2];
    return with.log_likelihood - here.log_likelihood;
}

}  // namespace grasptrack::pose
