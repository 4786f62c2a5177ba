// SPDX-License-Identifier: Apache-2.0
// One outline laid on another. Defined in kernels/reference_laying.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "evidence.hpp"
#include "motions.hpp"
#include "nearest.hpp"

namespace grasptrack {

struct LayStep {
    double reach, damping;
    std::size_t stride;
};

struct OutlineSamples {
    const Vec *points, *normals;
    std::size_t count;
};

// N x = b of a symmetric, positive definite N, by Cholesky; whether it is so.
inline bool solve8(Matrix8 N, Row8 b, Row8 &x) {
    for (int c = 0; c < 8; ++c) {
        for (int k = 0; k < c; ++k) N[c][c] -= N[c][k] * N[c][k];
        if (!(N[c][c] > 0)) return false;
        N[c][c] = std::sqrt(N[c][c]);
        for (int r = c + 1; r < 8; ++r) {
            for (int k = 0; k < c; ++k) N[r][c] -= N[r][k] * N[c][k];
            N[r][c] /= N[c][c];
        }
    }
    for (int r = 0; r < 8; ++r) {
        for (int k = 0; k < r; ++k) b[r] -= N[r][k] * b[k];
        b[r] /= N[r][r];
    }
    for (int r = 7; r >= 0; --r) {
        for (int k = r + 1; k < 8; ++k) b[r] -= N[k][r] * b[k];
        b[r] /= N[r][r];
    }
    x = b;
    return true;
}

class Laying {
  public:
    Laying(const OutlineSamples &first, const NearestAlike &second, double least_noise)
        : first_(first), second_(second), least_noise_(least_noise) {}

    // H after one step; whether there is one.
    bool step(double *H, const LayStep &how) {
        constexpr double tukey = 4.685;
        constexpr std::size_t enough = 12;
        if (!carry(H, how.stride)) return false;
        Vec centre{0, 0};
        for (const Vec &p : at_) centre = centre + p;
        centre = (1.0 / static_cast<double>(at_.size())) * centre;
        double spread = 0;
        for (const Vec &p : at_) spread += dot(p - centre, p - centre);
        const double radius = std::sqrt(spread / static_cast<double>(at_.size()));
        index_.clear(), where_.clear(), distance_.clear(), size_.clear();
        for (std::size_t i = 0; i < at_.size(); ++i) {
            const std::ptrdiff_t j = second_.find(at_[i], along_[i], how.reach);
            if (j < 0) continue;
            const auto target = static_cast<std::size_t>(j);
            index_.push_back(target);
            where_.push_back((1.0 / radius) * (at_[i] - centre));
            distance_.push_back(dot(second_.point(target) - at_[i], second_.normal(target)));
            size_.push_back(std::fabs(distance_.back()));
        }
        if (index_.size() < enough) return false;
        const double noise = std::max(1.4826 * lower_median(size_), least_noise_);
        Matrix8 N{};
        Row8 b{}, energy{}, x{}, fx, fy, a;
        for (std::size_t k = 0; k < index_.size(); ++k) {
            const double u = distance_[k] / (tukey * noise);
            if (!(std::fabs(u) < 1)) continue;
            const double weight = (1 - u * u) * (1 - u * u);
            const Vec n = second_.normal(index_[k]);
            fields(where_[k].x, where_[k].y, fx, fy);
            for (int r = 0; r < 8; ++r) {
                a[r] = n.x * fx[r] + n.y * fy[r];
                energy[r] += weight * (fx[r] * fx[r] + fy[r] * fy[r]);
                b[r] += weight * a[r] * distance_[k] / radius;
            }
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c <= r; ++c) N[r][c] += weight * a[r] * a[c];
        }
        for (int r = 0; r < 8; ++r) N[r][r] += how.damping * energy[r];
        return solve8(N, b, x) && move(H, x, centre, radius);
    }

    // px rms of what is left within reach; NaN where the outline turns over or goes to infinity.
    double left(const double *H, const LayStep &how) {
        if (!carry(H, how.stride)) return std::numeric_limits<double>::quiet_NaN();
        double sum = 0;
        for (std::size_t i = 0; i < at_.size(); ++i) {
            const std::ptrdiff_t j = second_.find(at_[i], along_[i], how.reach);
            const double gap = j < 0 ? how.reach : std::min(second_.gap(at_[i], static_cast<std::size_t>(j)), how.reach);
            sum += gap * gap;
        }
        return std::sqrt(sum / static_cast<double>(at_.size()));
    }

  private:
    bool carry(const double *H, std::size_t stride) {
        at_.clear(), along_.clear();
        double out[5];
        for (std::size_t i = 0; i < first_.count; i += stride) {
            carry_normal(H, H[8], &first_.points[i].x, &first_.normals[i].x, out);
            if (!(out[4] > 0)) return false;
            at_.push_back({out[0], out[1]});
            along_.push_back({out[2], out[3]});
        }
        return true;
    }

    OutlineSamples first_;
    const NearestAlike &second_;
    double least_noise_;
    std::vector<Vec> at_, along_, where_;
    std::vector<std::size_t> index_;
    std::vector<double> distance_, size_;
};

}  // namespace grasptrack
