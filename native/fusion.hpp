// SPDX-License-Identifier: Apache-2.0
// What an image says of a small motion: along an outline and on surfaces. Defined in kernels/reference_fusion.py.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "edges.hpp"
#include "evidence.hpp"
#include "outline.hpp"
#include "register.hpp"
#include "register.hpp"
#include "registration.hpp"

namespace grasptrack {

constexpr double kQuietSigma = 0.430727;
constexpr double kLeastNoiseGrey = 0.7;
constexpr std::size_t kFewest = 24;
constexpr int kLightWeighings = 4;
constexpr double kChance = 3.0;
constexpr double kDistinct = 5.0;
constexpr double kLeastReal = 0.4;
constexpr double kEdge = 2.0;

using Row4 = std::array<double, 4>;

struct Equations {
    Matrix8 N{}, sure{};
    Row8 b{};
    double total = 0.0, share = 0.0, noise = 0.0, correlation = 0.0;
};

struct MotionEquations {
    Vec centre{std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
    double radius = std::numeric_limits<double>::quiet_NaN();
    Matrix8 basis;
    std::vector<Equations> rows;
};

inline double quiet(std::vector<double> &size) {
    const auto third = size.begin() + static_cast<std::ptrdiff_t>((size.size() - 1) / 3);
    std::nth_element(size.begin(), third, size.end());
    return *third / kQuietSigma;
}

inline double tukey(double u) {
    u /= kTukey;
    const double rest = 1.0 - u * u;
    return std::fabs(u) < 1.0 ? rest * rest : 0.0;
}

// What is left of `told` without what chance could give, and how much of each motion that keeps.
inline Matrix8 without_chance(const Matrix8 &told, const Matrix8 &chance, Matrix8 *seen = nullptr) {
    Matrix8 S, V, out{};
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c) S[r][c] = told[r][c] - chance[r][c];
    const Row8 left = eigen(S, V);
    for (int e = 0; e < 8; ++e) {
        if (!(left[e] > 0.0)) continue;
        double by_chance = 0.0;
        if (seen)
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) by_chance += V[r][e] * chance[r][c] * V[c][e];
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) {
                out[r][c] += V[r][e] * left[e] * V[c][e];
                if (seen) (*seen)[r][c] += V[r][e] * V[c][e] * left[e] / (left[e] + by_chance);
            }
    }
    return out;
}

// The inverse of a symmetric positive 4 x 4 matrix; false where its rows are not independent.
inline bool inverted(const std::array<Row4, 4> &Q, std::array<Row4, 4> &out) {
    Row4 size;
    for (int i = 0; i < 4; ++i) {
        if (!(Q[i][i] > 0.0)) return false;
        size[i] = std::sqrt(Q[i][i]);
    }
    double a[4][8] = {}, determinant = 1.0;
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) a[r][c] = Q[r][c] / (size[r] * size[c]);
        a[r][4 + r] = 1.0;
    }
    for (int p = 0; p < 4; ++p) {  // of a correlation matrix the pivots need no exchange
        determinant *= a[p][p];
        if (!(determinant > 1e-9)) return false;
        const double pivot = a[p][p];
        for (double &value : a[p]) value /= pivot;
        for (int r = 0; r < 4; ++r) {
            if (r == p) continue;
            const double by = a[r][p];
            for (int c = 0; c < 8; ++c) a[r][c] -= by * a[p][c];
        }
    }
    for (int r = 0; r < 4; ++r)
        for (int c = 0; c < 4; ++c) out[r][c] = a[r][4 + c] / (size[r] * size[c]);
    return true;
}

struct SurfaceSamples {
    const Vec *places, *slopes;
    const double *values;
    std::size_t count;
};

class SurfaceFit {
  public:
    SurfaceFit(const Image<std::uint8_t> &coarse, double shrink, const double *H, Vec centre, double radius,
               const Matrix8 &basis)
        : coarse_(coarse), shrink_(shrink), centre_(centre), radius_(radius), basis_(basis) {
        for (int i = 0; i < 9; ++i) h_[i] = H[i] / H[8];
    }

    void add(const SurfaceSamples &samples, Equations &out) {
        if (!look(samples)) return;
        const std::size_t n = seen_.size();
        std::array<Row4, 4> inverse;
        Row4 light{};
        double noise = 0.0;
        std::vector<double> rest(n), weight(n), size(n);
        for (std::size_t i = 0; i < n; ++i) size[i] = rest[i] = seen_[i] - wanted_[i];
        const double middle = lower_median(size);
        for (double &value : rest) value -= middle;
        for (int round = 0; round < kLightWeighings; ++round) {
            for (std::size_t i = 0; i < n; ++i) size[i] = std::fabs(rest[i]);
            noise = std::max(quiet(size), kLeastNoiseGrey);
            std::array<Row4, 4> Q{};
            Row4 q{};
            for (std::size_t i = 0; i < n; ++i) {
                weight[i] = tukey(rest[i] / noise);
                for (int r = 0; r < 4; ++r) {
                    const double wr = weight[i] * R_[i][r];
                    q[r] += wr * seen_[i];
                    for (int c = 0; c < 4; ++c) Q[r][c] += wr * R_[i][c];
                }
            }
            if (!inverted(Q, inverse)) return;
            for (int r = 0; r < 4; ++r) {
                light[r] = 0.0;
                for (int c = 0; c < 4; ++c) light[r] += inverse[r][c] * q[c];
            }
            for (std::size_t i = 0; i < n; ++i) {
                rest[i] = seen_[i];
                for (int r = 0; r < 4; ++r) rest[i] -= R_[i][r] * light[r];
            }
        }
        equations(weight, rest, light[0], inverse, out);
        out.share = out.total / static_cast<double>(n);
        out.noise = noise;
        out.correlation = correlation(weight);
    }

  private:
    bool look(const SurfaceSamples &samples) {
        seen_.clear(), wanted_.clear(), place_.clear(), now_.clear(), then_.clear(), R_.clear();
        const double right = static_cast<double>(coarse_.width) - 1 - kEdge;
        const double bottom = static_cast<double>(coarse_.height) - 1 - kEdge;
        double mean = 0.0;
        for (std::size_t i = 0; i < samples.count; ++i) {
            const Vec p = samples.places[i], s = samples.slopes[i];
            const double w = h_[6] * p.x + h_[7] * p.y + 1.0;
            if (!(w > 1e-9)) continue;
            const Vec u{(h_[0] * p.x + h_[1] * p.y + h_[2]) / w, (h_[3] * p.x + h_[4] * p.y + h_[5]) / w};
            const Vec v{(u.x + 0.5) / shrink_ - 0.5, (u.y + 0.5) / shrink_ - 0.5};
            if (!(v.x >= kEdge && v.y >= kEdge && v.x < right && v.y < bottom)) continue;
            const double a = (h_[0] - h_[6] * u.x) / w, b = (h_[1] - h_[7] * u.x) / w;
            const double c = (h_[3] - h_[6] * u.y) / w, d = (h_[4] - h_[7] * u.y) / w, determinant = a * d - b * c;
            then_.push_back({(d * s.x - c * s.y) / determinant, (a * s.y - b * s.x) / determinant});
            now_.push_back({(coarse_.sample({v.x + 1, v.y}) - coarse_.sample({v.x - 1, v.y})) / (2 * shrink_),
                            (coarse_.sample({v.x, v.y + 1}) - coarse_.sample({v.x, v.y - 1})) / (2 * shrink_)});
            seen_.push_back(coarse_.sample(v));
            wanted_.push_back(samples.values[i]);
            place_.push_back({(u.x - centre_.x) / radius_, (u.y - centre_.y) / radius_});
            mean += samples.values[i];
        }
        if (seen_.size() < kFewest) return false;
        mean /= static_cast<double>(seen_.size());
        for (std::size_t i = 0; i < seen_.size(); ++i)
            R_.push_back({wanted_[i] - mean, 1.0, place_[i].x, place_[i].y});
        return true;
    }

    void equations(const std::vector<double> &weight, const std::vector<double> &rest, double gain,
                   const std::array<Row4, 4> &inverse, Equations &out) const {
        const std::size_t n = seen_.size();
        std::vector<Row8> now(n), then(n);
        std::array<Row8, 4> Rn{}, Rt{}, by_now{}, by_then{};  // what the light explains of the slopes
        Row8 fx, fy;
        for (std::size_t i = 0; i < n; ++i) {
            fields(place_[i].x, place_[i].y, fx, fy);
            Row8 a, b;
            for (int j = 0; j < 8; ++j) {
                a[j] = now_[i].x * fx[j] + now_[i].y * fy[j];
                b[j] = gain * (then_[i].x * fx[j] + then_[i].y * fy[j]);
            }
            now[i] = a, then[i] = b;
            for (int r = 0; r < 4; ++r) {
                const double wr = weight[i] * R_[i][r];
                for (int j = 0; j < 8; ++j) Rn[r][j] += wr * a[j], Rt[r][j] += wr * b[j];
            }
        }
        for (int r = 0; r < 4; ++r)
            for (int c = 0; c < 4; ++c)
                for (int j = 0; j < 8; ++j) {
                    by_now[r][j] += inverse[r][c] * Rn[c][j];
                    by_then[r][j] += inverse[r][c] * Rt[c][j];
                }
        Matrix8 raw{}, energy{};
        Row8 product{};
        for (std::size_t i = 0; i < n; ++i) {
            const double w = weight[i];
            if (w == 0.0) continue;
            out.total += w;
            Row8 a = now[i], b = then[i], mean;
            for (int r = 0; r < 4; ++r)
                for (int j = 0; j < 8; ++j) a[j] -= R_[i][r] * by_now[r][j], b[j] -= R_[i][r] * by_then[r][j];
            for (int j = 0; j < 8; ++j) mean[j] = 0.5 * (a[j] + b[j]);
            for (int r = 0; r < 8; ++r) {
                product[r] -= w * mean[r] * rest[i];
                const double wa = 0.5 * w * a[r], wb = 0.5 * w * b[r], wm = w * mean[r];
                for (int c = 0; c <= r; ++c) raw[r][c] += wa * b[c] + wb * a[c], energy[r][c] += wm * mean[c];
            }
        }
        const double by = kChance / std::sqrt(std::max(out.total, 1.0));
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < r; ++c) raw[c][r] = raw[r][c], energy[c][r] = energy[r][c];
        out.N = turned(energy);
        Matrix8 chance = out.N;
        for (auto &row : chance)
            for (double &value : row) value *= by;
        const Matrix8 told = turned(raw);
        out.sure = without_chance(told, chance);
        double real = 0.0, all = 0.0;
        for (int i = 0; i < 8; ++i) real += told[i][i], all += out.N[i][i];
        const double share = std::min(std::max(real / std::max(all, 1e-300), kLeastReal), 1.0);
        for (auto &row : out.N)
            for (double &value : row) value *= share;
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) out.b[c] += product[r] * basis_[r][c];
    }

    // In the basis.
    Matrix8 turned(const Matrix8 &M) const {
        Matrix8 half{}, out{};
        for (int r = 0; r < 8; ++r)
            for (int k = 0; k < 8; ++k)
                for (int c = 0; c < 8; ++c) half[r][c] += M[r][k] * basis_[k][c];
        for (int r = 0; r < 8; ++r)
            for (int k = 0; k < 8; ++k)
                for (int c = 0; c < 8; ++c) out[r][c] += basis_[k][r] * half[k][c];
        return out;
    }

    double correlation(const std::vector<double> &weight) const {
        double Q[3][3] = {}, q[3][2] = {};
        for (std::size_t i = 0; i < seen_.size(); ++i)
            for (int r = 0; r < 3; ++r) {
                const double wr = weight[i] * R_[i][r + 1];
                q[r][0] += wr * seen_[i], q[r][1] += wr * R_[i][0];
                for (int c = 0; c < 3; ++c) Q[r][c] += wr * R_[i][c + 1];
            }
        for (int p = 0; p < 3; ++p) {
            const double pivot = Q[p][p];
            for (int c = 0; c < 3; ++c) Q[p][c] /= pivot;
            q[p][0] /= pivot, q[p][1] /= pivot;
            for (int r = 0; r < 3; ++r) {
                if (r == p) continue;
                const double by = Q[r][p];
                for (int c = 0; c < 3; ++c) Q[r][c] -= by * Q[p][c];
                q[r][0] -= by * q[p][0], q[r][1] -= by * q[p][1];
            }
        }
        double aa = 0.0, bb = 0.0, ab = 0.0;
        for (std::size_t i = 0; i < seen_.size(); ++i) {
            double a = seen_[i], b = R_[i][0];
            for (int r = 0; r < 3; ++r) a -= R_[i][r + 1] * q[r][0], b -= R_[i][r + 1] * q[r][1];
            aa += weight[i] * a * a, bb += weight[i] * b * b, ab += weight[i] * a * b;
        }
        return aa > 0.0 && bb > 0.0 ? ab / std::sqrt(aa * bb) : 0.0;
    }

    const Image<std::uint8_t> &coarse_;
    double shrink_;
    Vec centre_;
    double radius_;
    const Matrix8 &basis_;
    double h_[9];
    std::vector<double> seen_, wanted_;
    std::vector<Vec> place_, now_, then_;
    std::vector<Row4> R_;
};

// By how much an image differs from the reference at some places, NaN where nothing can be compared; gives the noise.
inline double grey_differences(const Image<std::uint8_t> &coarse, double shrink, const double *H, const Vec *places,
                               const double *values, std::size_t p, double least_noise, double *out) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    std::fill(out, out + p, nan);
    double h[9];
    for (int i = 0; i < 9; ++i) h[i] = H[i] / H[8];
    const double right = static_cast<double>(coarse.width) - 1 - kEdge;
    const double bottom = static_cast<double>(coarse.height) - 1 - kEdge;
    std::vector<std::size_t> told;
    std::vector<double> seen, wanted;
    std::vector<Vec> at;
    for (std::size_t i = 0; i < p; ++i) {
        const double w = h[6] * places[i].x + h[7] * places[i].y + 1.0;
        if (!(w > 1e-9) || !std::isfinite(values[i])) continue;
        const Vec u{(h[0] * places[i].x + h[1] * places[i].y + h[2]) / w,
                    (h[3] * places[i].x + h[4] * places[i].y + h[5]) / w};
        const Vec v{(u.x + 0.5) / shrink - 0.5, (u.y + 0.5) / shrink - 0.5};
        if (!(v.x >= kEdge && v.y >= kEdge && v.x < right && v.y < bottom)) continue;
        told.push_back(i), at.push_back(u), seen.push_back(coarse.sample(v)), wanted.push_back(values[i]);
    }
    const std::size_t n = told.size();
    if (n < kFewest) return nan;
    const double middle = lower_median(wanted);
    std::vector<double> halves[2][2];
    for (std::size_t i = 0; i < n; ++i) {
        if (wanted[i] <= middle) halves[0][0].push_back(wanted[i]), halves[0][1].push_back(seen[i]);
        if (wanted[i] >= middle) halves[1][0].push_back(wanted[i]), halves[1][1].push_back(seen[i]);
    }
    const double before = lower_median(halves[1][0]) - lower_median(halves[0][0]);
    const double gain = before > kDistinct ? (lower_median(halves[1][1]) - lower_median(halves[0][1])) / before : 1.0;
    std::vector<double> rest(n), size(n);
    for (std::size_t i = 0; i < n; ++i) rest[i] = seen[i] - gain * wanted[i];
    const double level = lower_median(rest);
    Vec centre{0, 0};
    double mean = 0.0, spread = 0.0;
    for (std::size_t i = 0; i < n; ++i) rest[i] -= level, centre = centre + at[i], mean += wanted[i];
    centre = (1.0 / static_cast<double>(n)) * centre;
    mean /= static_cast<double>(n);
    for (const Vec &u : at) spread += dot(u - centre, u - centre);
    spread = std::sqrt(spread / (2.0 * static_cast<double>(n))) + 1e-9;
    std::vector<Row4> R(n);
    for (std::size_t i = 0; i < n; ++i)
        R[i] = {wanted[i] - mean, 1.0, (at[i].x - centre.x) / spread, (at[i].y - centre.y) / spread};
    double noise = least_noise;
    for (int round = 0; round < kLightWeighings; ++round) {
        for (std::size_t i = 0; i < n; ++i) size[i] = std::fabs(rest[i]);
        noise = std::max(quiet(size), least_noise);
        std::array<Row4, 4> Q{}, inverse;
        Row4 q{}, light{};
        for (std::size_t i = 0; i < n; ++i) {
            const double weight = tukey(rest[i] / noise);
            for (int r = 0; r < 4; ++r) {
                q[r] += weight * R[i][r] * seen[i];
                for (int c = 0; c < 4; ++c) Q[r][c] += weight * R[i][r] * R[i][c];
            }
        }
        if (!inverted(Q, inverse)) break;
        for (int r = 0; r < 4; ++r)
            for (int c = 0; c < 4; ++c) light[r] += inverse[r][c] * q[c];
        for (std::size_t i = 0; i < n; ++i) {
            rest[i] = seen[i];
            for (int r = 0; r < 4; ++r) rest[i] -= R[i][r] * light[r];
        }
    }
    for (std::size_t i = 0; i < n; ++i) out[told[i]] = rest[i];
    return noise;
}

// The part of the outline; false where H sends it to infinity. `left` and `weight` are of the samples.
inline bool outline_equations(const Image<std::uint8_t> &image, const double *H, const double *points,
                              const double *normals, const double *strength, std::size_t m, double reach,
                              const RegisterRules &rules, MotionEquations &out, double *left, double *weight) {
    std::vector<double> moved(5 * m);
    carry_normals(H, points, normals, static_cast<std::int64_t>(m), moved.data());
    std::vector<Vec> at(m), along(m);
    Vec centre{0, 0};
    for (std::size_t i = 0; i < m; ++i) {
        for (int j = 0; j < 5; ++j)
            if (!std::isfinite(moved[5 * i + j])) return false;
        at[i] = {moved[5 * i], moved[5 * i + 1]};
        along[i] = {moved[5 * i + 2], moved[5 * i + 3]};
        centre = centre + at[i];
    }
    out.centre = (1.0 / static_cast<double>(m)) * centre;
    double spread = 0.0;
    for (std::size_t i = 0; i < m; ++i) spread += dot(at[i] - out.centre, at[i] - out.centre);
    out.radius = std::sqrt(spread / static_cast<double>(m));
    Motions motions(m, 8);
    for (std::size_t i = 0; i < m; ++i) {
        const Vec place = (1.0 / out.radius) * (at[i] - out.centre);
        motions.set(i, place.x, place.y, along[i].x, along[i].y, 0.0);
    }
    motions.whiten();
    out.basis = motions.own;

    std::vector<Edge> edges(m);
    const auto direction = [&](std::size_t i) {
        if (rules.polarity != 0 || std::isinf(strength[i])) return rules.polarity;
        return strength[i] > 0 ? 1 : -1;
    };
    edge_search_each(image, {at.data(), m}, along.data(), reach, direction, edges.data());
    std::vector<double> gains;
    for (std::size_t i = 0; i < m; ++i)
        if (std::isfinite(edges[i].offset) && std::fabs(edges[i].strength) >= rules.least_strength)
            gains.push_back(std::fabs(edges[i].strength) / std::fabs(strength[i]));
    const double gain = lower_median(gains);
    std::vector<std::size_t> found;
    std::vector<double> size;
    std::size_t inside = 0;
    for (std::size_t i = 0; i < m; ++i) {
        if (!(at[i].x >= 1 && at[i].y >= 1 && at[i].x <= static_cast<double>(image.width - 2) &&
              at[i].y <= static_cast<double>(image.height - 2)))
            continue;
        ++inside;
        const double slope = std::fabs(edges[i].strength);
        if (!std::isfinite(edges[i].offset) || slope < rules.least_strength ||
            !(slope >= rules.relative_strength * gain * std::fabs(strength[i])))
            continue;
        found.push_back(i);
        size.push_back(std::fabs(edges[i].offset));
    }
    if (found.empty()) return true;
    Equations &row = out.rows[0];
    row.noise = std::max(quiet(size), kLeastNoisePx);
    std::fill(motions.weights(), motions.weights() + m, 0.0);
    for (const std::size_t i : found) {
        left[i] = edges[i].offset;
        weight[i] = motions.weights()[i] = tukey(edges[i].offset / row.noise);
        motions.set_offset(i, edges[i].offset);
    }
    Matrix8 told{}, chance{}, seen{};
    Row8 b{};
    row.total = motions.normal_equations(told, b);
    for (int i = 0; i < 8; ++i) chance[i][i] = kSliding * kSliding * row.total;
    row.N = row.sure = without_chance(told, chance, &seen);
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c) row.b[r] += seen[r][c] * b[c];
    row.share = row.total / static_cast<double>(std::max<std::size_t>(inside, 1));
    row.correlation = static_cast<double>(inside) / static_cast<double>(m);
    return true;
}

}  // namespace grasptrack
