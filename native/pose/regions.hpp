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
    double far;      // share of the size within which the outline must be seen on both sides
    double power;    // of a sample's cells: how much of an independent measurement they are
};

struct Levels {  // grey levels on one side of the visible outline near a sample
    double level = 0, spread = 0;
    bool known = false;
};

// Median and spread of the cells of the nearest visible samples; NaN where a cell does not count. Not known where the
// outline is not seen on both sides, at most `far` samples away: nothing is told of what lies far from all that fits.
inline Levels levels_near(std::size_t i, const std::vector<double> &visible, const std::vector<double> &cells, int far) {
    constexpr int near = 8, few = 4;  // samples that are asked, and that must be there, on each side
    constexpr double least = 3.0;        // grey levels, of any spread
    const auto n = static_cast<int>(visible.size());
    std::vector<double> levels;
    for (int side = -1; side <= 1; side += 2) {
        int found = 0;
        for (int step = 1; step <= std::min(far, n / 2) && found < near; ++step) {
            const auto j = static_cast<std::size_t>(((static_cast<int>(i) + side * step) % n + n) % n);
            if (visible[j] < 0.7) continue;
            ++found;
            for (std::size_t k = 0; k < region_cells; ++k)
                if (const double v = cells[j * region_cells + k]; v == v) levels.push_back(v);
        }
        if (found < few) return {};
    }
    Levels out;
    if (levels.size() < 3 * region_cells) return out;
    out.level = middle(levels);
    for (double &v : levels) v = std::abs(v - out.level);
    out.spread = 1.4826 * middle(levels) + least;
    out.known = true;
    return out;
}

inline double log_cell(double value, double level, double spread, double unlikely) {
    const double z = (value - level) / spread;
    return std::log((1 - unlikely) * std::exp(-0.5 * z * z) / (spread * 2.5066) + unlikely / 256.0);
}

// Whether a sample shows a boundary where its edge is expected, of whatever sign: what lies there ends there.
inline bool is_bounded(const EdgeSample &sample, double contrast) {
    constexpr double near = 2.0, faint = 0.25;  // work px; share of the first view's contrast
    for (int c = 0; c < sample.count; ++c)
        if (std::abs(sample.offset[static_cast<std::size_t>(c)]) < near &&
            std::abs(sample.step[static_cast<std::size_t>(c)]) > faint * std::abs(contrast))
            return true;
    return !sample.inside;
}

// Log-likelihood ratio of "some stretch shows another shape" against "this shape, partly occluded".
inline double other_shape(const Target &target, const Pyramid &pyramid, const Homography &G, const std::vector<double> &visible,
                          const std::vector<bool> &bounded, Light light, const RegionNumbers &numbers, const States &share, double stay, double power,
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
    // the inside less what it was, the outside where it is outside: light and background as they are here and now
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> changed(n * region_cells), beyond(n * region_cells);
    for (std::size_t q = 0; q < changed.size(); ++q) {
        changed[q] = inner[q] - (light.gain * target.inside[q] + light.bias);
        beyond[q] = target.outside[q] > 0 ? outer[q] : nothing;
    }
    std::vector<double> same(n, 1.0), differs(n, 0.05);  // where the edge is seen there is nothing to explain
    bool any = false;
    double length = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const Point p = target.points[i], q = target.points[(i + 1) % n];
        length += std::min(std::hypot(p.x - q.x, p.y - q.y), target.radius);
    }
    const int far = whole(numbers.far * 2 * target.radius * static_cast<double>(n) / length, 8, std::max(8, static_cast<int>(n)));
    for (std::size_t i = 0; i < n; ++i) {
        if (visible[i] > 0.5 || bounded[i]) continue;
        const Levels back = levels_near(i, visible, beyond, far), shift = levels_near(i, visible, changed, far);
        differs[i] = 1.0;
        if (!back.known || !shift.known) continue;
        const double spread = std::max(shift.spread, numbers.spread);
        double own_in = 0, back_in = 0, back_out = 0, own_out = 0, any_in = 0, any_out = 0;
        const double *edge = &target.inner[i * inner_pixels];
        double own = 0;
        for (int k = 0; k < inner_pixels; ++k) own += edge[k] / inner_pixels;
        own = light.gain * own + light.bias + shift.level;
        for (std::size_t k = 0; k < region_cells; ++k) {
            const std::size_t q = i * region_cells + k;
            if (target.inside[q] == target.inside[q] && inner[q] == inner[q]) {
                own_in += log_cell(inner[q], light.gain * target.inside[q] + light.bias + shift.level, spread, numbers.unlikely);
                back_in += log_cell(inner[q], back.level, back.spread, numbers.unlikely);
                any_in -= std::log(256.0);
            }
            if (target.outside[q] > 0 && outer[q] == outer[q]) {
                own_out += log_cell(outer[q], own, spread, numbers.unlikely);
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
