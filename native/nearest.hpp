// SPDX-License-Identifier: Apache-2.0
// The nearest point of an outline that goes the same way. Defined in kernels/reference_laying.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "geometry.hpp"

namespace grasptrack {

// The points of an outline in square cells, searched ring by ring.
class NearestAlike {
  public:
    static constexpr double alike = 0.5;

    NearestAlike(const Outline &outline, const Vec *normals)
        : points_(outline.points), normals_(normals), half_(outline.points.size) {
        Vec low = points_[0], high = points_[0];
        for (std::size_t i = 0; i < points_.size; ++i) {
            low = {std::min(low.x, points_[i].x), std::min(low.y, points_[i].y)};
            high = {std::max(high.x, points_[i].x), std::max(high.y, points_[i].y)};
        }
        for (std::size_t i = 0; i < points_.size; ++i)
            if (!std::isfinite(points_[i].x) || !std::isfinite(points_[i].y))
                throw std::invalid_argument("targets must be finite");
        origin_ = low;
        // about as many cells along a side as make a point or two of an outline fall into each that it passes
        const double side = std::max(high.x - low.x, high.y - low.y);
        cell_ = std::max(side / std::clamp(static_cast<double>(points_.size) / 12, 4.0, 64.0), 1e-9);
        columns_ = static_cast<int>((high.x - low.x) / cell_) + 1;
        rows_ = static_cast<int>((high.y - low.y) / cell_) + 1;
        begin_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
        std::vector<std::size_t> in(points_.size);
        for (std::size_t i = 0; i < points_.size; ++i) {
            in[i] = static_cast<std::size_t>(row(points_[i])) * columns_ + column(points_[i]);
            ++begin_[in[i] + 1];
        }
        for (std::size_t k = 1; k < begin_.size(); ++k) begin_[k] += begin_[k - 1];
        members_.resize(points_.size);
        std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
        for (std::size_t i = 0; i < points_.size; ++i) members_[next[in[i]]++] = {points_[i], normals_[i], i};
        for (std::size_t c = 0; c < outline.contours; ++c) {
            const auto from = static_cast<std::size_t>(outline.offsets[c]);
            const Points ring = outline.contour(c);
            double before = length(ring[0] - ring[ring.size - 1]);
            for (std::size_t i = 0; i < ring.size; ++i) {
                const double ahead = length(ring[i + 1 < ring.size ? i + 1 : 0] - ring[i]);
                half_[from + i] = 0.5 * std::max(before, ahead);
                before = ahead;
            }
        }
    }

    // Its index, -1 where none is within reach; of equally near ones the first.
    std::ptrdiff_t find(Vec at, Vec normal, double reach) const {
        if (!std::isfinite(at.x) || !std::isfinite(at.y)) return -1;
        double best = reach * reach;
        std::ptrdiff_t index = -1;
        const int c = static_cast<int>(std::clamp(std::floor((at.x - origin_.x) / cell_), -1e6, 1e6));
        const int r = static_cast<int>(std::clamp(std::floor((at.y - origin_.y) / cell_), -1e6, 1e6));
        const auto gap = [](int k, int last) { return k < 0 ? -k : k > last ? k - last : 0; };
        const int first = std::max(gap(c, columns_ - 1), gap(r, rows_ - 1));
        const int farthest = std::max({c, columns_ - 1 - c, r, rows_ - 1 - r, 0});
        for (int ring = first; ring <= farthest; ++ring) {
            if (ring > 0) {  // no member of this ring is nearer than to the inner side of it
                const double inner = (ring - 1) * cell_ + inset(at, c, r);
                if (inner * inner > best) break;
            }
            const int top = std::max(r - ring, 0), bottom = std::min(r + ring, rows_ - 1);
            for (int y = top; y <= bottom; ++y) {
                const bool whole = y == r - ring || y == r + ring;
                if (whole) {
                    look(y, std::max(c - ring, 0), std::min(c + ring, columns_ - 1), at, normal, best, index);
                } else {
                    if (c - ring >= 0 && c - ring < columns_) look(y, c - ring, c - ring, at, normal, best, index);
                    if (c + ring >= 0 && c + ring < columns_) look(y, c + ring, c + ring, at, normal, best, index);
                }
            }
        }
        return index;
    }

    // px from a point to the piece of the tangent at target `index`.
    double gap(Vec at, std::size_t index) const {
        const Vec way = points_[index] - at, across = normals_[index];
        const double off = dot(way, across), beyond = std::max(std::fabs(cross(way, across)) - half_[index], 0.0);
        return std::sqrt(off * off + beyond * beyond);
    }

    Vec point(std::size_t index) const { return points_[index]; }
    Vec normal(std::size_t index) const { return normals_[index]; }

  private:
    struct Member {
        Vec at, normal;
        std::size_t index;
    };

    int column(Vec p) const { return std::min(static_cast<int>((p.x - origin_.x) / cell_), columns_ - 1); }
    int row(Vec p) const { return std::min(static_cast<int>((p.y - origin_.y) / cell_), rows_ - 1); }

    // From a point to the nearest side of its cell.
    double inset(Vec at, int c, int r) const {
        const double x = at.x - origin_.x - c * cell_, y = at.y - origin_.y - r * cell_;
        return std::max(std::min({x, y, cell_ - x, cell_ - y}), 0.0);
    }

    void look(int y, int from, int to, Vec at, Vec normal, double &best, std::ptrdiff_t &index) const {
        if (from > to) return;
        const std::size_t cell = static_cast<std::size_t>(y) * columns_;
        for (std::size_t k = begin_[cell + from]; k < begin_[cell + to + 1]; ++k) {
            const Member &m = members_[k];
            const Vec way = at - m.at;
            const double square = dot(way, way);
            const auto mine = static_cast<std::ptrdiff_t>(m.index);
            if (square > best || (square == best && index >= 0 && mine > index) || !(dot(normal, m.normal) >= alike))
                continue;
            best = square;
            index = mine;
        }
    }

    Points points_;
    const Vec *normals_;
    std::vector<double> half_;
    Vec origin_{0, 0};
    double cell_ = 1;
    int columns_ = 1, rows_ = 1;
    std::vector<std::size_t> begin_;
    std::vector<Member> members_;
};

}  // namespace grasptrack
