// SPDX-License-Identifier: Apache-2.0
// Eq. (3): curvature compared between two outlines (Section IV-C.1). Defined in kernels/reference_matching.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace grasptrack {

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
    double error;
};

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
        const bool good = best <= tolerance * std::max(std::abs(first.values[i]), circle);
        out.push_back({good ? chosen : -1, best});
    }
    return out;
}

}  // namespace grasptrack
