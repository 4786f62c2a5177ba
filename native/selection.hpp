// SPDX-License-Identifier: Apache-2.0
// The k-th smallest of many values, exact, without sorting them: nearly all are only counted.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace grasptrack {

class Selection {
  public:
    // Of n values, n > k; they stay as they are. None is NaN.
    double operator()(const double *values, std::size_t n, std::size_t k) {
        constexpr std::size_t some = 128, either = 14;  // beyond so many ranks of a sample it seldom lies
        if (n > 3 * some) {
            double sample[some];
            for (std::size_t i = 0; i < some; ++i) sample[i] = values[i * n / some];
            std::sort(sample, sample + some);
            const std::size_t rank = k * some / n;
            const double low = rank < either ? -std::numeric_limits<double>::infinity() : sample[rank - either];
            const double high = rank + either < some ? sample[rank + either] : std::numeric_limits<double>::infinity();
            double found;
            if (between(values, n, k, low, high, found)) return found;
        }
        double *room = room_for(n);
        std::copy(values, values + n, room);
        std::nth_element(room, room + k, room + n);
        return room[k];
    }

    // The same, given nearly what it is, above 0.
    double near(const double *values, std::size_t n, std::size_t k, double guess) {
        double found;
        return between(values, n, k, 0.8 * guess, 1.25 * guess, found) ? found : (*this)(values, n, k);
    }

  private:
    bool between(const double *values, std::size_t n, std::size_t k, double low, double high, double &found) {
        std::size_t below = 0, kept = 0;
        double *room = room_for(n + 1);
        for (std::size_t i = 0; i < n; ++i) {
            const double value = values[i];
            below += value < low ? 1 : 0;
            room[kept] = value;
            kept += (value >= low) & (value <= high) ? 1 : 0;
        }
        if (k < below || k >= below + kept) return false;
        std::nth_element(room, room + (k - below), room + kept);
        found = room[k - below];
        return true;
    }

    double *room_for(std::size_t n) {
        if (room_.size() < n) room_.resize(n);
        return room_.data();
    }

    std::vector<double> room_;
};

}  // namespace grasptrack
