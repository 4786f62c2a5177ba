// SPDX-License-Identifier: Apache-2.0
// Independent regions of contact: how far contacts may slip along the outline, each as it likes, and the grasp closes.
#pragma once

#include <algorithm>
#include <array>
#include <queue>
#include <vector>

#include "closure.hpp"

namespace grasptrack {

// Candidates along closed contours: contour c holds those from starts[c], `steps[c]` px of arc length apart.
class Along {
  public:
    Along(Points contacts, const Vec *normals, const bool *usable, const std::int64_t *starts, const double *steps,
          std::size_t contours, double friction, Vec centre, double rho)
        : contacts_(contacts), normals_(normals), usable_(usable), starts_(starts), steps_(steps),
          friction_(friction), home_(contacts.size), cone_(contacts.size), turn_(contacts.size), edges_(contacts.size) {
        const double angle = std::atan(friction);
        for (std::size_t c = 0; c < contours; ++c)
            for (std::int64_t i = starts[c]; i < starts[c + 1]; ++i) home_[i] = c;
        for (std::size_t i = 0; i < contacts.size; ++i) {
            const Vec n = normals[i], t{-n.y, n.x};
            double turn = 0;
            for (std::int64_t way : {-1, 1}) {
                const Vec m = normals[moved(i, way)];
                turn = std::max(turn, std::atan2(std::fabs(cross(n, m)), dot(n, m)));
            }
            turn_[i] = turn;
            cone_[i] = usable[i] && turn < angle ? std::tan(angle - turn) : -1.0;
            const Vec arm = (1 / rho) * (contacts[i] - centre), f = n + friction * t, g = n - friction * t;
            edges_[i] = {Wrench{f.x, f.y, cross(arm, f)}, Wrench{g.x, g.y, cross(arm, g)}};
        }
    }

    double step(std::size_t i) const { return steps_[home_[i]]; }
    Vec contact(std::size_t i) const { return contacts_[i]; }

    // Squares of pairs are tried ring by ring. Each is held to a narrower cone, by what a normal turns to the next
    // candidate and the line with half a step at either end, so that what lies between candidates closes as well.
    double pair(std::size_t a, std::size_t b, double needed, double most) const {
        const double step_a = step(a), step_b = step(b), step_least = std::min(step_a, step_b);
        const std::int64_t limit = std::min({steps_within(most, step_least), count(a) / 2, count(b) / 2});
        const double sense = dot(normals_[a], contacts_[b] - contacts_[a]) > 0 ? 1.0 : -1.0;
        const double slip = (step_a + step_b) / 2;
        const double distance = length(contacts_[b] - contacts_[a]), slant = slip * (1 + friction_ * friction_);
        std::int64_t k = 0;
        if (closes(a, b, sense, slant, 0)) {
            for (k = 1; k <= limit; ++k) {
                // far contacts stay far: one distance serves the ring
                const double near = distance - static_cast<double>(k) * (step_a + step_b);
                const double lean = near > 0.75 * distance ? slant / near : 0;
                bool good = true;
                for (std::int64_t e = -k; good && e <= k; ++e)
                    good = closes(moved(a, e), moved(b, -k), sense, slant, lean) &&
                           closes(moved(a, e), moved(b, k), sense, slant, lean) &&
                           closes(moved(a, -k), moved(b, e), sense, slant, lean) &&
                           closes(moved(a, k), moved(b, e), sense, slant, lean);
                if (!good) break;
            }
            --k;
        }
        if (k > 0) return std::min(static_cast<double>(k) * step_least, most);
        const double spare = std::atan(friction_) - std::atan(needed);
        const double change = std::max(turn_[a], turn_[b]) + 2 * slip / distance;
        return std::min({step_least, most, step_least * spare / (2 * change)});
    }

    // As long as no edge of a cone moves by epsilon, in wrenches, the hull still holds the origin.
    double one_of_three(std::size_t i, double epsilon, double most) const {
        const double step_i = step(i);
        const std::int64_t limit = std::min(steps_within(most, step_i), count(i) / 2);
        double first = 0;
        std::int64_t k = 1;
        for (; k <= std::max<std::int64_t>(limit, 1); ++k) {
            bool good = true;
            for (std::int64_t way : {-1, 1}) {
                const std::size_t here = moved(i, way * k), before = moved(i, way * (k - 1));
                const double between = apart(here, before);
                if (k == 1) first = std::max(first, between);
                good &= usable_[here] && apart(here, i) + between < epsilon;
            }
            if (!good) break;
        }
        --k;
        if (k > 0) return std::min(static_cast<double>(k) * step_i, most);
        return std::min({step_i, most, step_i * epsilon / (2 * std::max(first, 1e-12))});
    }

  private:
    // Steps that reach as far as `most`: where all of them are good the room is 1, and nothing can be better.
    static std::int64_t steps_within(double most, double step) {
        return static_cast<std::int64_t>(std::min(std::ceil(most / step - 1e-9), 1e9));
    }

    std::int64_t count(std::size_t i) const { return starts_[home_[i] + 1] - starts_[home_[i]]; }

    std::size_t moved(std::size_t i, std::int64_t by) const {
        const std::int64_t first = starts_[home_[i]], n = count(i);
        std::int64_t at = static_cast<std::int64_t>(i) - first + by;
        if (at >= n) at -= n;
        if (at < 0) at += n;
        return static_cast<std::size_t>(first + at);
    }

    // lean: an upper bound of what the line's slant by half a step adds to the friction needed, or 0 where unknown.
    bool closes(std::size_t i, std::size_t j, double sense, double slant, double lean) const {
        if (!(cone_[i] > 0 && cone_[j] > 0)) return false;
        const Vec d = contacts_[j] - contacts_[i];
        const double p = sense * dot(normals_[i], d), q = -sense * dot(normals_[j], d);
        if (!(p > 0 && q > 0)) return false;
        if (lean == 0) lean = slant / length(d);
        return std::fabs(cross(normals_[i], d)) < (cone_[i] - lean) * p &&
               std::fabs(cross(normals_[j], d)) < (cone_[j] - lean) * q;
    }

    double apart(std::size_t i, std::size_t j) const {
        double most = 0;
        for (int e = 0; e < 2; ++e) {
            const Wrench d = edges_[i][e] - edges_[j][e];
            most = std::max(most, dot(d, d));
        }
        return std::sqrt(most);
    }

    Points contacts_;
    const Vec *normals_;
    const bool *usable_;
    const std::int64_t *starts_;
    const double *steps_;
    double friction_;
    std::vector<std::size_t> home_;
    std::vector<double> cone_, turn_;
    std::vector<std::array<Wrench, 2>> edges_;
};

// The best of many grasps, none near another; the room of a contact is worked out only where it may matter.

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
