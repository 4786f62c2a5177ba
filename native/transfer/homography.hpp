// SPDX-License-Identifier: Apache-2.0
// Transfer by a homography (Section IV-C): peaks of curvature, and the four of them that fix a homography best; these found
// again on another outline; contacts carried and moved onto it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "../geometry/homography.hpp"
#include "../geometry/places.hpp"

namespace grasptrack {

constexpr int kMaxPeaks = 8;
// Curvatures that lie closer together, as a share of the highest, are equal. Rounding moves them by less than 1e-11 of it; what
// is not equal, on contours of pixels too, lies more than 1e-8 apart.
constexpr double kEqualCurvature = 1e-10;

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

// Samples in falling order of their values, those that are equal in order of index.
inline void sort_by_level(std::vector<std::int64_t> &samples, const std::vector<double> &v, double equal) {
    std::sort(samples.begin(), samples.end(), [&](auto a, auto b) { return v[a] > v[b]; });
    for (auto first = samples.begin(); first != samples.end();) {
        auto last = first + 1;
        while (last != samples.end() && v[*(last - 1)] - v[*last] <= equal) ++last;
        std::sort(first, last);
        first = last;
    }
}

// Of equal neighbours the last is the peak, and of equal peaks the first comes first.
inline std::vector<std::int64_t> curvature_peaks(const double *curvature, const double *arc, std::int64_t n,
                                                 double separation, double prominence) {
    std::vector<double> v(n);
    double equal = 0.0;
    for (std::int64_t i = 0; i < n; ++i) v[i] = std::abs(curvature[i]), equal = std::max(equal, kEqualCurvature * v[i]);
    std::vector<std::int64_t> crests, peaks;
    for (std::int64_t i = 0; i < n; ++i)  // what is lower than the prominence cannot rise by it
        if (v[i] >= prominence && v[i] >= v[i == 0 ? n - 1 : i - 1] - equal && v[i] > v[i + 1 == n ? 0 : i + 1] + equal)
            crests.push_back(i);
    sort_by_level(crests, v, equal);
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
    if (best.index[0] < 0) return {peaks};  // of points that are not finite there are no best
    Selected selected{{}, best.triangle};
    for (int i : best.index) selected.peaks.push_back(peaks[i]);
    for (int i = 0; i < static_cast<int>(peaks.size()); ++i)
        if (std::find(best.index.begin(), best.index.end(), i) == best.index.end()) selected.peaks.push_back(peaks[i]);
    return selected;
}

// Eq. (3): curvature compared between two outlines (Section IV-C.1).

// A closed sequence over arc length, linear between samples.
struct Cyclic {
    const double *values, *arc;
    std::int64_t size;

    double length() const { return arc[size]; }
    double wrapped(double s) const { return s - std::floor(s / length()) * length(); }

    // The last sample at or before s in [0, length).
    std::int64_t at(double s) const {
        const std::int64_t after = std::upper_bound(arc, arc + size, s) - arc;
        return after > 0 ? after - 1 : 0;
    }

    // The value at s, found from a sample i near by; i is moved to the one at or before s.
    double read(double s, std::int64_t &i) const {
        if (s < 0.0 || s >= length()) s = wrapped(s);
        if (std::abs(s - arc[i]) > 0.5 * length()) i = at(s);  // it lies beyond the end, where the count starts anew
        while (i > 0 && s < arc[i]) --i;
        while (i + 1 < size && s >= arc[i + 1]) ++i;
        const double ahead = s - arc[i], width = arc[i + 1] - arc[i];
        if (!(ahead > 0.0 && width > 0.0)) return values[i];
        return values[i] + ahead / width * (values[i + 1 < size ? i + 1 : 0] - values[i]);
    }
};

struct Match {
    std::int64_t sample;
    double error, place;
};

// The place near a sample about which a sequence is most like the one wanted: two steps of Gauss and Newton, of one side
// at most. NaN where the minimum lies beyond the window, or beyond what can be compared. `here` is room for an index of each.
inline double place_between_samples(const Cyclic &second, const std::vector<double> &wanted, const std::vector<double> &ahead,
                                    double kappa, double centre, double limit, std::int64_t sample,
                                    std::vector<std::int64_t> &here) {
    const double middle = second.arc[sample], after = second.arc[sample + 1] - middle;
    const double before = middle - (sample > 0 ? second.arc[sample - 1] : second.arc[second.size - 1] - second.length());
    double offset = middle - centre;
    offset -= std::round(offset / second.length()) * second.length();
    // slopes across both sides: they are the same whichever way the contour runs
    thread_local std::vector<double> slope;
    slope.resize(wanted.size());
    double shift = 0.0, weight = 0.0;
    std::fill(here.begin(), here.end(), -1);
    for (std::size_t k = 0; k < wanted.size(); ++k) {
        if (here[k] < 0) here[k] = k > 1 ? here[k - 2] : sample;
        const double at = middle + kappa * ahead[k], low = second.read(at - before, here[k]);
        slope[k] = (second.read(at + after, here[k]) - low) / (before + after);
        weight += slope[k] * slope[k];
    }
    if (std::isnan(weight)) return weight;
    for (int round = 0; round < 2; ++round) {
        double sum = 0.0;
        for (std::size_t k = 0; k < wanted.size(); ++k)
            sum += slope[k] * (wanted[k] - second.read(middle + shift + kappa * ahead[k], here[k]));
        if (!(weight > 0.0)) break;
        const double moved = shift + sum / weight;
        if (!std::isfinite(moved)) return std::numeric_limits<double>::quiet_NaN();
        shift = std::min(std::max(moved, -before), after);
    }
    if (!(std::abs(offset + shift) <= limit)) return std::numeric_limits<double>::quiet_NaN();
    const double size = static_cast<double>(second.size);
    double place = static_cast<double>(sample) + (shift == 0.0 ? 0.0 : shift / (shift > 0.0 ? after : before));
    if (place < 0.0) place += size;
    return place < size ? place : place - size;  // so little before the first that it is rounded to the end is the first
}

// Eq. (3) for some samples of the first contour.
inline std::vector<Match> match_curvature(const Cyclic &first, const std::vector<std::int64_t> &indices,
                                          const Cyclic &second, const std::vector<double> &centres, double kappa,
                                          double reach, int radius, double step, double tolerance) {
    constexpr double circle = 6.28318530717958647692;
    const int size = 2 * radius + 1;
    // Neighbours from the middle outward, one ahead, one behind: where curves differ at a peak, the middle tells first.
    std::vector<double> ahead(size), wanted(size);
    for (int k = 0; k < size; ++k) ahead[k] = (k % 2 ? (k + 1) / 2 : -(k / 2)) * step;
    std::vector<std::int64_t> here(size);
    const auto start = [&](int k, std::int64_t middle) { return k > 1 ? here[k - 2] : middle; };
    std::vector<Match> out;
    for (std::size_t row = 0; row < indices.size(); ++row) {
        const std::int64_t i = indices[row];
        for (int k = 0; k < size; ++k) {
            here[k] = start(k, i);
            wanted[k] = first.read(first.arc[i] + ahead[k], here[k]);
        }
        double best = std::numeric_limits<double>::infinity();
        std::int64_t chosen = -1;
        const double centre = second.wrapped(centres[row]), limit = kappa * reach;
        const std::int64_t middle = second.at(centre);
        // Whether sample j is in the window; its error then replaces the best if it is smaller.
        const auto weigh = [&](std::int64_t j) {
            double gap = std::abs(second.arc[j] - centre);
            gap = std::min(gap, second.length() - gap);
            if (!(gap <= limit)) return false;
            double error = 0.0;
            for (int k = 0; k < size; ++k) {
                if (here[k] < 0) here[k] = start(k, j);
                error += std::abs(wanted[k] - second.read(second.arc[j] + kappa * ahead[k], here[k]));
                if (error > best) return true;  // it only grows
            }
            if (error < best) best = error, chosen = j;  // never so for a NaN
            return true;
        };
        // From the centre to either side: the match is near it, and the better the best, the sooner others are done.
        std::fill(here.begin(), here.end(), -1);
        std::int64_t j = middle + 1 < second.size ? middle + 1 : 0, left = second.size;
        for (; left > 0 && weigh(j); --left) j = j + 1 < second.size ? j + 1 : 0;
        std::fill(here.begin(), here.end(), -1);
        j = middle;
        for (; left > 0 && weigh(j); --left) j = j > 0 ? j - 1 : second.size - 1;
        best /= size;
        const bool good = chosen >= 0 && best <= tolerance * std::max(std::abs(first.values[i]), circle);
        if (!good) chosen = -1;
        out.push_back({chosen, best,
                       good ? place_between_samples(second, wanted, ahead, kappa, centre, limit, chosen, here)
                            : std::numeric_limits<double>::quiet_NaN()});
    }
    return out;
}

// Contacts carried by a homography and moved onto the outline (Fig. 11).

struct Refined {
    double residual = 0.0, growth = 0.0, in_front = std::numeric_limits<double>::infinity();

    void moved(Vec by) {
        const double distance = length(by);
        if (!(distance <= residual)) residual = distance;  // a NaN stays
    }
};

// normals is null for two contacts, which move along their line.
inline Refined refine_contacts(const double *H, Points contacts, const Vec *normals, const Outline &outline, Vec *out) {
    Refined result;
    double side = 0;
    for (std::size_t i = 0; i < contacts.size; ++i) {
        const Local carried = local(H, contacts[i]);
        out[i] = carried.at;
        if (i == 0) {
            side = carried.lambda < 0 ? -1 : 1;
            result.growth = std::sqrt(std::fabs(carried.xx * carried.yy - carried.xy * carried.yx));
        }
        if (!(side * carried.lambda >= result.in_front)) result.in_front = side * carried.lambda;
        if (!normals) continue;
        // Normals go by the inverse transpose, up to scale.
        const Vec n = normals[i];
        Vec along{carried.yy * n.x - carried.yx * n.y, carried.xx * n.y - carried.xy * n.x};
        along = (1 / length(along)) * along;
        Nearest nearest{0};
        for_each_crossing(outline, {out[i], along}, [&](std::size_t, double, double t) { nearest.offer(t); });
        out[i] = out[i] + nearest.t * along;
        if (!std::isnan(result.residual)) result.moved(nearest.t * along);
    }
    if (normals) return result;
    const double opening = length(out[1] - out[0]);
    const Vec along = (1 / opening) * (out[1] - out[0]);
    Nearest a{0}, b{opening};
    for_each_crossing(outline, {out[0], along}, [&](std::size_t, double, double t) { a.offer(t), b.offer(t); });
    result.residual = std::max(std::fabs(a.t), std::fabs(b.t - opening));
    if (std::isnan(a.t)) result.residual = a.t;
    if (a.t == b.t) result.residual = std::numeric_limits<double>::infinity();
    out[1] = out[0] + b.t * along;
    out[0] = out[0] + a.t * along;
    return result;
}

}  // namespace grasptrack
