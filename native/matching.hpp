// SPDX-License-Identifier: Apache-2.0
// Matching of curvature and of whole outlines (Section IV-C.1). What each function means is said in
// kernels/reference_matching.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

namespace grasptrack {

constexpr int kMaxPeaks = 8;
constexpr std::int64_t kMaxGrid = 2048;

inline std::vector<std::int64_t> curvature_peaks(const double* curvature, const double* arc, std::int64_t n,
                                                 double separation, double prominence) {
    std::vector<std::int64_t> crest, peaks;
    const double length = arc[n];
    auto v = [&](std::int64_t i) { return std::abs(curvature[i]); };
    for (std::int64_t i = 0; i < n; ++i)
        if (v(i) >= v(i == 0 ? n - 1 : i - 1) && v(i) > v(i + 1 == n ? 0 : i + 1)) crest.push_back(i);
    std::stable_sort(crest.begin(), crest.end(), [&](auto a, auto b) { return v(a) > v(b); });
    for (auto i : crest) {
        const bool crowded = std::any_of(peaks.begin(), peaks.end(), [&](auto p) {
            const double gap = std::abs(arc[i] - arc[p]);
            return std::min(gap, length - gap) < separation;
        });
        if (crowded) continue;
        double least_rise = std::numeric_limits<double>::infinity();
        for (int direction : {1, -1}) {
            double low = v(i), travelled = 0.0;
            for (std::int64_t j = i; travelled <= 3.0 * separation && travelled < length;) {
                const std::int64_t k = direction > 0 ? (j + 1 == n ? 0 : j + 1) : (j == 0 ? n - 1 : j - 1);
                const std::int64_t a = direction > 0 ? j : k;
                travelled += arc[a + 1] - arc[a];
                j = k;
                if (v(j) < low) low = v(j);
            }
            least_rise = std::min(least_rise, v(i) - low);
        }
        if (least_rise >= prominence) peaks.push_back(i);
        if (static_cast<int>(peaks.size()) == kMaxPeaks) break;
    }
    return peaks;
}

struct Quadrilateral {
    std::array<int, 4> index{-1, -1, -1, -1};
    double triangle = 0.0;
};

inline Quadrilateral best_quadrilateral(const double* p, const double* weight, int m) {
    Quadrilateral best;
    double score = -1.0;
    auto area = [&](int a, int b, int c) {
        const double ux = p[2 * b] - p[2 * a], uy = p[2 * b + 1] - p[2 * a + 1];
        const double wx = p[2 * c] - p[2 * a], wy = p[2 * c + 1] - p[2 * a + 1];
        return 0.5 * std::abs(ux * wy - uy * wx);
    };
    for (int a = 0; a < m; ++a)
        for (int b = a + 1; b < m; ++b)
            for (int c = b + 1; c < m; ++c)
                for (int d = c + 1; d < m; ++d) {
                    const double least = std::min({area(a, b, c), area(a, b, d), area(a, c, d), area(b, c, d)});
                    const double value =
                        least * std::sqrt(std::min({weight[a], weight[b], weight[c], weight[d]}));
                    if (value > score * (1.0 + 1e-9)) {
                        score = value;
                        best = {{a, b, c, d}, least};
                    }
                }
    return best;
}

// a, b: count complex numbers each, interleaved, already centred and of unit norm.
inline void cyclic_correlation(const double* a, const double* b, std::int64_t count, double* out) {
    std::vector<double> ar(count), ai(count), br(2 * count), bi(2 * count);
    for (std::int64_t i = 0; i < count; ++i) {
        ar[i] = a[2 * i];
        ai[i] = a[2 * i + 1];
        br[i] = br[i + count] = b[2 * i];
        bi[i] = bi[i + count] = b[2 * i + 1];
    }
    std::vector<double> re(count, 0.0), im(count, 0.0);
    for (std::int64_t i = 0; i < count; ++i) {
        const double x = ar[i], y = ai[i];
        const double *u = br.data() + i, *w = bi.data() + i;
        for (std::int64_t k = 0; k < count; ++k) {  // conj(a_i) b_(i + k)
            re[k] += x * u[k] + y * w[k];
            im[k] += x * w[k] - y * u[k];
        }
    }
    for (std::int64_t k = 0; k < count; ++k) {
        out[2 * k] = re[k];
        out[2 * k + 1] = im[k];
    }
}

inline void centre_and_normalise(double* z, std::int64_t count) {
    double mx = 0.0, my = 0.0, norm = 0.0;
    for (std::int64_t i = 0; i < count; ++i) mx += z[2 * i], my += z[2 * i + 1];
    mx /= static_cast<double>(count);
    my /= static_cast<double>(count);
    for (std::int64_t i = 0; i < count; ++i) {
        z[2 * i] -= mx;
        z[2 * i + 1] -= my;
        norm += z[2 * i] * z[2 * i] + z[2 * i + 1] * z[2 * i + 1];
    }
    norm = std::sqrt(norm);
    for (std::int64_t i = 0; i < 2 * count; ++i) z[i] /= norm;
}

// A closed curvature vector looked up by arc length, linear between samples.
inline double curvature_at(const double* v, const double* arc, std::int64_t n, double s) {
    s -= std::floor(s / arc[n]) * arc[n];
    std::int64_t i = std::upper_bound(arc, arc + n + 1, s) - arc - 1;
    i = std::clamp<std::int64_t>(i, 0, n - 1);
    const double width = arc[i + 1] - arc[i];
    const double f = width > 0.0 ? (s - arc[i]) / width : 0.0;
    const double next = v[i + 1 == n ? 0 : i + 1];
    return v[i] + f * (next - v[i]);
}

// Eq. (3) for m points; out is (m, 2).
inline void match_curvature(const double* v1, const double* arc1, std::int64_t n1, const std::int64_t* indices,
                            std::int64_t m, const double* v2, const double* arc2, std::int64_t n2,
                            const double* centres, double kappa, double reach, int radius, double step, double* out) {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    const std::int64_t count = std::min<std::int64_t>(4 * n2, kMaxGrid);
    const double length2 = arc2[n2], cell = length2 / static_cast<double>(count);
    std::vector<double> grid(count + 1);
    for (std::int64_t g = 0, i = 0; g < count; ++g) {
        const double s = static_cast<double>(g) * cell;
        while (i + 1 < n2 && arc2[i + 1] <= s) ++i;
        const double width = arc2[i + 1] - arc2[i];
        const double f = width > 0.0 ? (s - arc2[i]) / width : 0.0;
        grid[g] = v2[i] + f * (v2[i + 1 == n2 ? 0 : i + 1] - v2[i]);
    }
    grid[count] = grid[0];
    const int size = 2 * radius + 1;
    std::vector<double> wanted(size);
    const double per_cell = static_cast<double>(count) / length2;
    for (std::int64_t row = 0; row < m; ++row) {
        for (int k = 0; k < size; ++k)
            wanted[k] = curvature_at(v1, arc1, n1, arc1[indices[row]] + (k - radius) * step);
        double best = kNone;
        std::int64_t chosen = -1;
        for (std::int64_t j = 0; j < n2; ++j) {
            double gap = arc2[j] - centres[row] + 0.5 * length2;
            gap -= std::floor(gap / length2) * length2;
            if (std::abs(gap - 0.5 * length2) > kappa * reach) continue;
            double error = 0.0;
            for (int k = 0; k < size; ++k) {
                double s = arc2[j] + kappa * step * (k - radius);
                if (s < 0.0) s += length2;
                if (s >= length2) s -= length2;
                const double at = s * per_cell;
                const std::int64_t low = std::clamp<std::int64_t>(static_cast<std::int64_t>(at), 0, count - 1);
                const double f = at - static_cast<double>(low);
                error += std::abs(wanted[k] - (grid[low] + f * (grid[low + 1] - grid[low])));
            }
            error /= size;
            if (error < best) {  // never so for a NaN
                best = error;
                chosen = j;
            }
        }
        out[2 * row] = static_cast<double>(chosen);
        out[2 * row + 1] = best;
    }
}

}  // namespace grasptrack
