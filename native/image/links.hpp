// SPDX-License-Identifier: Apache-2.0
// Links between the ends of broken edges.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace grasptrack {

struct EdgeEnd {
    std::int64_t x, y;
    double dx, dy;      // unit, the way it would go on
    std::int64_t size;  // pixels of its edge
};

using Link = std::array<std::int64_t, 4>;

class EdgeMap {
  public:
    EdgeMap(const std::uint8_t *edges, std::int64_t height, std::int64_t width)
        : edges_(edges), height_(height), width_(width), label_(static_cast<std::size_t>(height * width), 0) {}

    std::vector<EdgeEnd> ends() {
        std::vector<EdgeEnd> found;
        for (std::int64_t y = MARGIN; y < height_ - MARGIN; ++y) {
            for (std::int64_t x = MARGIN; x < width_ - MARGIN; ++x) {
                if (edges_[y * width_ + x] == 0 || beside(x, y) > 1) continue;
                std::int64_t px[BACK], py[BACK];
                const int steps = walk(x, y, px, py);
                if (steps < LEAST) continue;
                const auto dx = static_cast<double>(px[0] - px[steps - 1]), dy = static_cast<double>(py[0] - py[steps - 1]);
                const double norm = std::sqrt(dx * dx + dy * dy);
                found.push_back({x, y, norm > 0 ? dx / norm : 0.0, norm > 0 ? dy / norm : 0.0, size_of(y * width_ + x)});
            }
        }
        return found;
    }

  private:
    static constexpr int BACK = 12, LEAST = 8;
    static constexpr std::int64_t MARGIN = 3;
    static constexpr int AROUND[8][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}};

    bool on(std::int64_t x, std::int64_t y) const {
        return x >= 0 && y >= 0 && x < width_ && y < height_ && edges_[y * width_ + x] != 0;
    }

    int beside(std::int64_t x, std::int64_t y) const {
        int count = 0;
        for (const auto &step : AROUND) count += on(x + step[0], y + step[1]);
        return count;
    }

    int walk(std::int64_t x, std::int64_t y, std::int64_t *px, std::int64_t *py) const {
        std::int64_t seen[1 + 8 * BACK];
        int known = 0, steps = 1;
        px[0] = x, py[0] = y;
        seen[known++] = y * width_ + x;
        while (steps < BACK) {
            const std::int64_t cx = px[steps - 1], cy = py[steps - 1];
            bool moved = false;
            const int before = known;
            for (const auto &step : AROUND) {
                const std::int64_t u = cx + step[0], v = cy + step[1];
                if (!on(u, v) || std::find(seen, seen + before, v * width_ + u) != seen + before) continue;
                if (!moved) px[steps] = u, py[steps] = v, moved = true;
                seen[known++] = v * width_ + u;
            }
            if (!moved) break;
            ++steps;
        }
        return steps;
    }

    // Pixels of the edge that holds one, counted when it is first asked for.
    std::int64_t size_of(std::int64_t pixel) {
        if (label_[pixel] == 0) {
            sizes_.push_back(0);
            const auto name = static_cast<std::int32_t>(sizes_.size());
            stack_.assign(1, pixel);
            label_[pixel] = name;
            while (!stack_.empty()) {
                const std::int64_t at = stack_.back(), x = at % width_, y = at / width_;
                stack_.pop_back();
                ++sizes_.back();
                for (const auto &step : AROUND) {
                    const std::int64_t u = x + step[0], v = y + step[1];
                    if (!on(u, v) || label_[v * width_ + u] != 0) continue;
                    label_[v * width_ + u] = name;
                    stack_.push_back(v * width_ + u);
                }
            }
        }
        return sizes_[static_cast<std::size_t>(label_[pixel]) - 1];
    }

    const std::uint8_t *edges_;
    std::int64_t height_, width_;
    std::vector<std::int32_t> label_;
    std::vector<std::int64_t> sizes_, stack_;
};

inline std::vector<Link> edge_links(const std::uint8_t *edges, std::int64_t height, std::int64_t width, double reach,
                                    double bend, double loose) {
    constexpr double NEAR = 8.0, WEIGHT = 4.0, REACH_OF_LENGTH = 1.5;
    const std::vector<EdgeEnd> ends = EdgeMap(edges, height, width).ends();
    std::vector<std::int64_t> best(ends.size(), -1);
    for (std::size_t i = 0; i < ends.size(); ++i) {
        double lowest = std::numeric_limits<double>::infinity();
        // In the order of rows: what is within reach is one run.
        const double far = std::min(reach, REACH_OF_LENGTH * static_cast<double>(ends[i].size)), row = static_cast<double>(ends[i].y);
        const auto begin = std::partition_point(ends.begin(), ends.end(), [&](const EdgeEnd &e) { return static_cast<double>(e.y) < row - far; });
        for (auto j = static_cast<std::size_t>(begin - ends.begin()); j < ends.size() && static_cast<double>(ends[j].y) <= row + far; ++j) {
            const auto gx = static_cast<double>(ends[j].x - ends[i].x), gy = static_cast<double>(ends[j].y - ends[i].y);
            const double gap = std::sqrt(gx * gx + gy * gy);
            if (j == i || gap == 0 || gap > reach ||
                gap > REACH_OF_LENGTH * static_cast<double>(std::min(ends[i].size, ends[j].size)))
                continue;
            const double dx = gx / gap, dy = gy / gap;
            const double one = std::acos(std::clamp(ends[i].dx * dx + ends[i].dy * dy, -1.0, 1.0));
            const double other = std::acos(std::clamp(-ends[j].dx * dx - ends[j].dy * dy, -1.0, 1.0));
            if (std::max(one, other) > (gap < NEAR ? loose : bend)) continue;
            const double cost = gap * (1.0 + WEIGHT * (one * one + other * other));
            if (cost < lowest) best[i] = static_cast<std::int64_t>(j), lowest = cost;
        }
    }
    std::vector<Link> links;
    for (std::size_t i = 0; i < ends.size(); ++i) {
        const std::int64_t j = best[i];
        if (j < static_cast<std::int64_t>(i) || best[static_cast<std::size_t>(j)] != static_cast<std::int64_t>(i)) continue;
        const EdgeEnd &a = ends[i], &b = ends[static_cast<std::size_t>(j)];
        links.push_back({a.x, a.y, b.x, b.y});
    }
    return links;
}

}  // namespace grasptrack
