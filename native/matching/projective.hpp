// SPDX-License-Identifier: Apache-2.0
// Homographies near the identity by the motions that they are made of.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "../geometry/points.hpp"
#include "../geometry/homography.hpp"

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

// The middle value, of two the lower one; 0 of none. NaN, which has no place in an order, does not count.
inline double lower_median(std::vector<double> values) {
    values.erase(std::remove_if(values.begin(), values.end(), [](double a) { return std::isnan(a); }), values.end());
    if (values.empty()) return 0.0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// The nearest point of an outline that goes the same way.

// The points of an outline in square cells, searched ring by ring.
class NearestAlike {
  public:
    static constexpr double alike = 0.5;

    NearestAlike(const Outline &outline, const Vec *normals)
        : points_(outline.points), normals_(normals), half_(outline.points.size) {
        Vec low = points_[0], high = points_[0];
        for (std::size_t i = 0; i < points_.size; ++i) {
            low = {std::min(low.x, points_[i].x), std::min(low.y, points_[i].y)};
            high = {std::max(high.x, points_[i].x), std::max(high.y, points_[i].y)};
        }
        for (std::size_t i = 0; i < points_.size; ++i)
            if (!std::isfinite(points_[i].x) || !std::isfinite(points_[i].y))
                throw std::invalid_argument("targets must be finite");
        origin_ = low;
        // about as many cells along a side as make a point or two of an outline fall into each that it passes
        const double side = std::max(high.x - low.x, high.y - low.y);
        cell_ = std::max(side / std::clamp(static_cast<double>(points_.size) / 12, 4.0, 64.0), 1e-9);
        columns_ = static_cast<int>((high.x - low.x) / cell_) + 1;
        rows_ = static_cast<int>((high.y - low.y) / cell_) + 1;
        begin_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
        std::vector<std::size_t> in(points_.size);
        for (std::size_t i = 0; i < points_.size; ++i) {
            in[i] = static_cast<std::size_t>(row(points_[i])) * columns_ + column(points_[i]);
            ++begin_[in[i] + 1];
        }
        for (std::size_t k = 1; k < begin_.size(); ++k) begin_[k] += begin_[k - 1];
        members_.resize(points_.size);
        std::vector<std::size_t> next(begin_.begin(), begin_.end() - 1);
        for (std::size_t i = 0; i < points_.size; ++i) members_[next[in[i]]++] = {points_[i], normals_[i], i};
        for (std::size_t c = 0; c < outline.contours; ++c) {
            const auto from = static_cast<std::size_t>(outline.offsets[c]);
            const Points ring = outline.contour(c);
            double before = length(ring[0] - ring[ring.size - 1]);
            for (std::size_t i = 0; i < ring.size; ++i) {
                const double ahead = length(ring[i + 1 < ring.size ? i + 1 : 0] - ring[i]);
                half_[from + i] = 0.5 * std::max(before, ahead);
                before = ahead;
            }
        }
    }

    // Its index, -1 where none is within reach; of equally near ones the first.
    std::ptrdiff_t find(Vec at, Vec normal, double reach) const {
        if (!std::isfinite(at.x) || !std::isfinite(at.y)) return -1;
        double best = reach * reach;
        std::ptrdiff_t index = -1;
        const int c = static_cast<int>(std::clamp(std::floor((at.x - origin_.x) / cell_), -1e6, 1e6));
        const int r = static_cast<int>(std::clamp(std::floor((at.y - origin_.y) / cell_), -1e6, 1e6));
        const auto gap = [](int k, int last) { return k < 0 ? -k : k > last ? k - last : 0; };
        const int first = std::max(gap(c, columns_ - 1), gap(r, rows_ - 1));
        const int farthest = std::max({c, columns_ - 1 - c, r, rows_ - 1 - r, 0});
        for (int ring = first; ring <= farthest; ++ring) {
            if (ring > 0) {  // no member of this ring is nearer than to the inner side of it
                const double inner = (ring - 1) * cell_ + inset(at, c, r);
                if (inner * inner > best) break;
            }
            const int top = std::max(r - ring, 0), bottom = std::min(r + ring, rows_ - 1);
            for (int y = top; y <= bottom; ++y) {
                const bool whole = y == r - ring || y == r + ring;
                if (whole) {
                    look(y, std::max(c - ring, 0), std::min(c + ring, columns_ - 1), at, normal, best, index);
                } else {
                    if (c - ring >= 0 && c - ring < columns_) look(y, c - ring, c - ring, at, normal, best, index);
                    if (c + ring >= 0 && c + ring < columns_) look(y, c + ring, c + ring, at, normal, best, index);
                }
            }
        }
        return index;
    }

    // px from a point to the piece of the tangent at target `index`.
    double gap(Vec at, std::size_t index) const {
        const Vec way = points_[index] - at, across = normals_[index];
        const double off = dot(way, across), beyond = std::max(std::fabs(cross(way, across)) - half_[index], 0.0);
        return std::sqrt(off * off + beyond * beyond);
    }

    Vec point(std::size_t index) const { return points_[index]; }
    Vec normal(std::size_t index) const { return normals_[index]; }

  private:
    struct Member {
        Vec at, normal;
        std::size_t index;
    };

    int column(Vec p) const { return std::min(static_cast<int>((p.x - origin_.x) / cell_), columns_ - 1); }
    int row(Vec p) const { return std::min(static_cast<int>((p.y - origin_.y) / cell_), rows_ - 1); }

    // From a point to the nearest side of its cell.
    double inset(Vec at, int c, int r) const {
        const double x = at.x - origin_.x - c * cell_, y = at.y - origin_.y - r * cell_;
        return std::max(std::min({x, y, cell_ - x, cell_ - y}), 0.0);
    }

    void look(int y, int from, int to, Vec at, Vec normal, double &best, std::ptrdiff_t &index) const {
        if (from > to) return;
        const std::size_t cell = static_cast<std::size_t>(y) * columns_;
        for (std::size_t k = begin_[cell + from]; k < begin_[cell + to + 1]; ++k) {
            const Member &m = members_[k];
            const Vec way = at - m.at;
            const double square = dot(way, way);
            const auto mine = static_cast<std::ptrdiff_t>(m.index);
            if (square > best || (square == best && index >= 0 && mine > index) || !(dot(normal, m.normal) >= alike))
                continue;
            best = square;
            index = mine;
        }
    }

    Points points_;
    const Vec *normals_;
    std::vector<double> half_;
    Vec origin_{0, 0};
    double cell_ = 1;
    int columns_ = 1, rows_ = 1;
    std::vector<std::size_t> begin_;
    std::vector<Member> members_;
};

// One outline laid on another.

struct AlignmentStep {
    double reach, damping;
    std::size_t stride;
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

class ProjectiveAlignment {
  public:
    ProjectiveAlignment(Points points, const Vec *normals, const NearestAlike &second, double least_noise)
        : points_(points), normals_(normals), second_(second), least_noise_(least_noise) {}

    // H after one step; whether there is one.
    bool step(double *H, const AlignmentStep &how) {
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
    double left(const double *H, const AlignmentStep &how) {
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
        for (std::size_t i = 0; i < points_.size; i += stride) {
            const CarriedNormal here = carry_normal(H, H[8], points_[i], normals_[i]);
            if (!(here.determinant > 0)) return false;
            at_.push_back(here.at);
            along_.push_back(here.normal);
        }
        return true;
    }

    Points points_;
    const Vec *normals_;
    const NearestAlike &second_;
    double least_noise_;
    std::vector<Vec> at_, along_, where_;
    std::vector<std::size_t> index_;
    std::vector<double> distance_, size_;
};

}  // namespace grasptrack
