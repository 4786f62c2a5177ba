// SPDX-License-Identifier: Apache-2.0
// Homographies near the identity by the motions that they are made of. Defined in kernels/reference_evidence.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "geometry.hpp"

namespace grasptrack {

using Row8 = std::array<double, 8>;
using Matrix8 = std::array<Row8, 8>;

// Rows x and y of the displacement fields at one point.
inline void fields(double x, double y, Row8 &fx, Row8 &fy) {
    fx = {1.0, 0.0, x, -y, x, y, x * x, x * y};
    fy = {0.0, 1.0, y, x, -y, x, x * y, y * y};
}

// H moved by the homography near the identity with these parameters, in radii; whether its last element is not 0.
inline bool move(double *H, const Row8 &x, Vec centre, double radius) {
    const double M[3][3] = {{1.0 + x[2] + x[4], x[5] - x[3], x[0]},
                            {x[5] + x[3], 1.0 + x[2] - x[4], x[1]},
                            {-x[6], -x[7], 1.0}};
    const double N[3][3] = {{1.0 / radius, 0.0, -centre.x / radius}, {0.0, 1.0 / radius, -centre.y / radius}, {0, 0, 1}};
    const double back[3][3] = {{radius, 0.0, centre.x}, {0.0, radius, centre.y}, {0, 0, 1}};
    double h[3][3], a[3][3] = {}, b[3][3] = {}, c[3][3] = {};
    for (int i = 0; i < 9; ++i) h[i / 3][i % 3] = H[i];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) a[i][j] += M[i][k] * N[k][j];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) b[i][j] += back[i][k] * a[k][j];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) c[i][j] += b[i][k] * h[k][j];
    if (!(std::fabs(c[2][2]) > 1e-12)) return false;
    for (int i = 0; i < 9; ++i) H[i] = c[i / 3][i % 3] / c[2][2];
    return true;
}

// The middle value, of two the lower one; 0 of none.
inline double lower_median(std::vector<double> values) {
    if (values.empty()) return 0.0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace grasptrack
