// SPDX-License-Identifier: Apache-2.0
// Medians and whole numbers of values that may be anything: the data decide about neither memory nor time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace grasptrack::pose {

// The value of rank n / 2 of at least one; NaN, which `<` does not order, counts as the largest. Reorders them.
inline double middle(std::vector<double> &values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    if (std::any_of(values.begin(), values.end(), [](double a) { return a != a; }))
        std::nth_element(values.begin(), at, values.end(), [](double a, double b) { return a < b || (b != b && a == a); });
    else
        std::nth_element(values.begin(), at, values.end());
    return *at;
}

// A number without its fraction, within bounds; the lower one where it is none.
inline int whole(double value, int low, int high) {
    if (value != value) return low;
    return static_cast<int>(std::clamp(value, static_cast<double>(low), static_cast<double>(high)));
}

}  // namespace grasptrack::pose
