// SPDX-License-Identifier: Apache-2.0
// The best of many grasps, none near another; the room of a contact is worked out only where it may matter.
#pragma once

#include <algorithm>
#include <array>
#include <queue>
#include <vector>

#include "regions.hpp"

namespace grasptrack {

struct Ranked {
    std::int64_t index;
    double quality;
    std::array<double, 3> regions;
};

class Ranking {
  public:
    Ranking(const Along &along, const std::int64_t *grasps, std::size_t fingers, const double *strength, double most,
            double gap)
        : along_(along), grasps_(grasps), fingers_(fingers), strength_(strength), most_(most), gap_(gap) {}

    // bound: quality of a grasp whose room were 1.
    std::vector<Ranked> best(const double *bound, std::size_t count, std::size_t top) const {
        struct Entry {
            double quality;
            bool exact;
            std::int64_t index;
            std::array<double, 3> regions;
            bool operator<(const Entry &o) const {
                if (quality != o.quality) return quality < o.quality;
                if (exact != o.exact) return exact;  // what may be as good is worked out first
                return index > o.index;
            }
        };
        std::vector<Entry> entries;
        entries.reserve(count);
        for (std::size_t g = 0; g < count; ++g) entries.push_back({bound[g], false, static_cast<std::int64_t>(g), {}});
        std::priority_queue<Entry> queue(std::less<Entry>(), std::move(entries));
        std::vector<Ranked> chosen;
        while (!queue.empty() && chosen.size() < top) {
            Entry entry = queue.top();
            queue.pop();
            if (near_any(entry.index, chosen)) continue;
            if (entry.exact) {
                chosen.push_back({entry.index, entry.quality, entry.regions});
                continue;
            }
            entry.regions = regions(entry.index);
            const double least = *std::min_element(entry.regions.begin(), entry.regions.begin() + fingers_);
            entry.quality *= 0.2 + 0.8 * std::sqrt(std::min(least / most_, 1.0));
            entry.exact = true;
            queue.push(entry);
        }
        return chosen;
    }

  private:
    std::array<double, 3> regions(std::int64_t index) const {
        const std::int64_t *g = grasps_ + index * fingers_;
        if (fingers_ == 2) {
            const double both = along_.pair(g[0], g[1], strength_[index], most_);
            return {both, both, 0.0};
        }
        return {along_.one_of_three(g[0], strength_[index], most_), along_.one_of_three(g[1], strength_[index], most_),
                along_.one_of_three(g[2], strength_[index], most_)};
    }

    bool near_any(std::int64_t index, const std::vector<Ranked> &chosen) const {
        static constexpr int orders[6][3] = {{0, 1, 2}, {1, 0, 2}, {0, 2, 1}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
        const std::int64_t *g = grasps_ + index * fingers_;
        for (const Ranked &other : chosen) {
            const std::int64_t *h = grasps_ + other.index * fingers_;
            for (int o = 0; o < (fingers_ == 2 ? 2 : 6); ++o) {
                bool close = true;
                for (std::size_t f = 0; close && f < fingers_; ++f)
                    close = length(along_.contact(g[f]) - along_.contact(h[orders[o][f]])) < gap_;
                if (close) return true;
            }
        }
        return false;
    }

    const Along &along_;
    const std::int64_t *grasps_;
    std::size_t fingers_;
    const double *strength_;
    double most_, gap_;
};

}  // namespace grasptrack
