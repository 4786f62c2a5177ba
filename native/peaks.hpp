// SPDX-License-Identifier: Apache-2.0
// Peaks of curvature, and the four of them that fix a homography best (Section IV-C). What each function means is said
// in kernels/reference_peaks.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace grasptrack {

constexpr int kMaxPeaks = 8;

// Whether a closed sequence falls by some prominence within reach of a sample, on both sides.
class Surroundings {
  public:
    Surroundings(const double *v, const double *arc, std::int64_t n, double reach, double prominence)
        : v_(v), arc_(arc), n_(n), reach_(reach), prominence_(prominence) {}

    bool fall_away_from(std::int64_t i) {
        // A few peaks are looked at one by one; when there are many crests, all valleys are found in one sweep.
        if (looked_at_++ < 2 * kMaxPeaks) return 0.0 >= prominence_ || (falls(i, 1) && falls(i, -1));
        if (lowest_[0].empty()) lowest_[0] = lowest(1), lowest_[1] = lowest(-1);
        return v_[i] - std::max(lowest_[0][i], lowest_[1][i]) >= prominence_ || 0.0 >= prominence_;
    }

  private:
    // Indices run on beyond the ends: -1 is the last sample of the lap before.
    std::int64_t wrapped(std::int64_t i) const { return i < 0 ? i + n_ : (i < n_ ? i : i - n_); }
    double place(std::int64_t i) const {
        if (i < 0) return arc_[i + n_] - arc_[n_];
        return i < n_ ? arc_[i] : arc_[i - n_] + arc_[n_];
    }

    // Whether the neighbour of `last`, seen from i, still belongs to the surroundings.
    bool goes_on(std::int64_t i, std::int64_t last) const {
        const double travelled = std::abs(place(last) - arc_[i]);
        return travelled <= reach_ && std::abs(last - i) < n_;
    }

    bool falls(std::int64_t i, int way) const {
        for (std::int64_t j = i; goes_on(i, j);) {
            j += way;
            if (v_[i] - v_[wrapped(j)] >= prominence_) return true;
        }
        return false;
    }

    // The lowest value in the surroundings of each sample on one side: a sliding minimum, linear in all.
    std::vector<double> lowest(int way) const {
        std::vector<double> out(n_);
        std::vector<std::int64_t> rising(2 * n_ + 1);  // positions whose values rise; the front is the lowest
        std::size_t front = 0, back = 0;
        std::int64_t last = way > 0 ? 0 : n_ - 1;
        for (std::int64_t step = 0; step < n_; ++step) {
            const std::int64_t i = way > 0 ? step : n_ - 1 - step;
            while (goes_on(i, last)) {
                last += way;
                const double value = v_[wrapped(last)];
                if (std::isnan(value)) continue;
                while (back > front && v_[wrapped(rising[back - 1])] >= value) --back;
                rising[back++] = last;
            }
            while (back > front && way * rising[front] <= way * i) ++front;
            out[i] = back > front ? v_[wrapped(rising[front])] : std::numeric_limits<double>::infinity();
        }
        return out;
    }

    const double *v_, *arc_;
    std::int64_t n_;
    double reach_, prominence_;
    int looked_at_ = 0;
    std::vector<double> lowest_[2];
};

inline std::vector<std::int64_t> curvature_peaks(const double *curvature, const double *arc, std::int64_t n,
                                                 double separation, double prominence) {
    std::vector<double> v(n);
    for (std::int64_t i = 0; i < n; ++i) v[i] = std::abs(curvature[i]);
    std::vector<std::int64_t> crests, peaks;
    for (std::int64_t i = 0; i < n; ++i)  // what is lower than the prominence cannot rise by it
        if (v[i] >= prominence && v[i] >= v[i == 0 ? n - 1 : i - 1] && v[i] > v[i + 1 == n ? 0 : i + 1])
            crests.push_back(i);
    std::sort(crests.begin(), crests.end(), [&](auto a, auto b) { return v[a] > v[b] || (v[a] == v[b] && a < b); });
    Surroundings surroundings(v.data(), arc, n, 3.0 * separation, prominence);
    for (auto i : crests) {
        const bool crowded = std::any_of(peaks.begin(), peaks.end(), [&](auto p) {
            const double gap = std::abs(arc[i] - arc[p]);
            return std::min(gap, arc[n] - gap) < separation;
        });
        if (!crowded && surroundings.fall_away_from(i)) peaks.push_back(i);
        if (static_cast<int>(peaks.size()) == kMaxPeaks) break;
    }
    return peaks;
}

struct Quadrilateral {
    std::array<int, 4> index{-1, -1, -1, -1};
    double triangle = 0.0;
};

// point(i) is a Vec, weight(i) a number, for i below m.
template <typename Point, typename Weight> Quadrilateral best_quadrilateral(Point point, Weight weight, int m) {
    Quadrilateral best;
    double score = -1.0;
    const auto area = [](Vec a, Vec b, Vec c) { return 0.5 * std::abs(cross(b - a, c - a)); };
    for (int a = 0; a < m; ++a)
        for (int b = a + 1; b < m; ++b)
            for (int c = b + 1; c < m; ++c) {
                const Vec p = point(a), q = point(b), r = point(c);
                const double abc = area(p, q, r), lightest = std::min({weight(a), weight(b), weight(c)});
                for (int d = c + 1; d < m; ++d) {
                    const Vec s = point(d);
                    const double least = std::min({abc, area(p, q, s), area(p, r, s), area(q, r, s)});
                    const double value = least * std::sqrt(std::min(lightest, weight(d)));
                    if (value > score * (1.0 + 1e-9)) {
                        score = value;
                        best = {{a, b, c, d}, least};
                    }
                }
            }
    return best;
}

struct Selected {
    std::vector<std::int64_t> peaks;
    double triangle = 0.0;
};

inline Selected select_points(Points points, const double *arc, const double *curvature, double separation,
                              double prominence) {
    const auto peaks = curvature_peaks(curvature, arc, static_cast<std::int64_t>(points.size), separation, prominence);
    if (peaks.size() < 4) return {peaks};
    const auto best = best_quadrilateral([&](int i) { return points[peaks[i]]; },
                                         [&](int i) { return std::abs(curvature[peaks[i]]); },
                                         static_cast<int>(peaks.size()));
    Selected selected{{}, best.triangle};
    for (int i : best.index) selected.peaks.push_back(peaks[i]);
    for (int i = 0; i < static_cast<int>(peaks.size()); ++i)
        if (std::find(best.index.begin(), best.index.end(), i) == best.index.end()) selected.peaks.push_back(peaks[i]);
    return selected;
}

}  // namespace grasptrack
