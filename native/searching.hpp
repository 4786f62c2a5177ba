// SPDX-License-Identifier: Apache-2.0
// Camera and object from all sightings at once: robust Levenberg-Marquardt with a prior.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "linear.hpp"
#include "sightings.hpp"

namespace grasptrack {

struct Sightings {
    const double *later, *hands, *points, *noise;  // (N,), (N, 4, 4), (N, n, 2), (N, n, 2, 2)
    std::size_t N, n;
};

// The sightings as one system of equations.
class SightingEvidence {
  public:
    SightingEvidence(const Sightings &seen, const double *origin, const double *known, double robust)
        : seen_(seen), origin_(origin), known_(known), robust_(robust), size_(unknown::shape + 2 * seen.n),
          white_(3 * seen.N * seen.n), off_(2 * seen.N * seen.n), size2_(seen.N), d_(size_), A(size_ * size_), b(size_) {
        for (std::size_t k = 0; k < seen.N * seen.n; ++k) {
            const double *R = seen.noise + 4 * k;
            const double a = std::sqrt(R[0]), l = R[2] / a, c = std::sqrt(R[3] - l * l);
            if (!(a > 0.0 && c > 0.0)) throw std::invalid_argument("Matrix is not positive definite");
            white_[3 * k] = 1.0 / a, white_[3 * k + 1] = -l / (a * c), white_[3 * k + 2] = 1.0 / c;
        }
    }

    std::size_t size() const { return size_; }

    // What a state leaves of the sightings, and of what was known before.
    void look(const double *s) {
        for (std::size_t k = 0; k < seen_.N; ++k) {
            double sum = 0.0;
            for (std::size_t i = 0; i < seen_.n; ++i) {
                const std::size_t at = k * seen_.n + i;
                const Seen one(s, seen_.hands + 16 * k, seen_.later[k], i);
                const double u = seen_.points[2 * at] - one.at[0], v = seen_.points[2 * at + 1] - one.at[1];
                const double *W = &white_[3 * at];
                off_[2 * at] = W[0] * u, off_[2 * at + 1] = W[1] * u + W[2] * v;
                sum += off_[2 * at] * off_[2 * at] + off_[2 * at + 1] * off_[2 * at + 1];
            }
            size2_[k] = std::isnan(sum) ? std::numeric_limits<double>::infinity() : sum / double(2 * seen_.n);
        }
        difference(origin_, s, seen_.n, d_.data());
        prior_ = 0.0;
        for (std::size_t i = 0; i < size_; ++i)
            for (std::size_t j = 0; j < size_; ++j) prior_ += d_[i] * known_[i * size_ + j] * d_[j];
    }

    double cost(double scale) const {
        const double unit = (robust_ * scale) * (robust_ * scale);
        double shares = 0.0;
        for (double value : size2_) {
            const double u = value / unit;
            shares += std::isfinite(u) ? u / (1.0 + u) : 1.0;
        }
        return double(2 * seen_.n) * unit * shares + prior_;
    }

    // The scale of what is left, where it is not much like the last one; 0 where there is none.
    double scale(double last) const {
        std::vector<double> sorted(size2_);
        std::sort(sorted.begin(), sorted.end());
        const std::size_t N = sorted.size();
        const double median = 0.5 * (sorted[(N - 1) / 2] + sorted[N / 2]);
        double now = std::max(1.0, 1.5 * std::sqrt(median));
        if (!std::isfinite(now)) now = 1e3;
        return last == 0.0 || std::abs(now - last) > 0.2 * last ? now : last;
    }

    // Normal equations A x = b at the state that was looked at.
    void equations(const double *s, double scale) {
        std::fill(A.begin(), A.end(), 0.0);
        std::fill(b.begin(), b.end(), 0.0);
        for (std::size_t i = 0; i < seen_.n; ++i) {
            constexpr std::size_t own = unknown::own;
            double part[own][own] = {}, right[own] = {}, J[2][own];
            for (std::size_t k = 0; k < seen_.N; ++k) {
                if (!std::isfinite(size2_[k])) continue;  // behind the camera: it asks for nothing
                const double softened = 1.0 + size2_[k] / ((robust_ * scale) * (robust_ * scale));
                const double weight = 1.0 / (softened * softened);
                const std::size_t at = k * seen_.n + i;
                const Seen one(s, seen_.hands + 16 * k, seen_.later[k], i);
                one.slopes(s, seen_.hands + 16 * k, seen_.later[k], i, J);
                const double *W = &white_[3 * at];
                for (std::size_t c = 0; c < own; ++c) {
                    J[1][c] = W[1] * J[0][c] + W[2] * J[1][c];
                    J[0][c] *= W[0];
                }
                const double first = off_[2 * at], second = off_[2 * at + 1];
                for (std::size_t r = 0; r < own; ++r) {
                    const double u = weight * J[0][r], v = weight * J[1][r];
                    right[r] += u * first + v * second;
                    for (std::size_t c = 0; c < own; ++c) part[r][c] += u * J[0][c] + v * J[1][c];
                }
            }
            for (std::size_t r = 0; r < own; ++r) {
                const std::size_t row = column(r, i);
                b[row] += right[r];
                for (std::size_t c = 0; c < own; ++c) A[row * size_ + column(c, i)] += part[r][c];
            }
        }
        for (std::size_t r = 0; r < size_; ++r)
            for (std::size_t c = 0; c < size_; ++c) {
                A[r * size_ + c] += known_[r * size_ + c];
                b[r] -= known_[r * size_ + c] * d_[c];
            }
    }

  private:
    Sightings seen_;
    const double *origin_, *known_;
    double robust_;
    std::size_t size_;
    std::vector<double> white_, off_, size2_, d_;
    double prior_ = 0.0;

  public:
    std::vector<double> A, b;
};

// rad by which a step may turn camera or object: one that tips the object's plane over ends where its back explains almost
// as much, and no small step leads back.
constexpr double farthest_turn = 0.5;

inline bool turns_too_far(const double *step) {
    const auto angle = [](const double *v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); };
    return !(std::max(angle(step + unknown::turn), angle(step + unknown::pose)) <= farthest_turn);
}

struct Searched {
    std::vector<double> state;
    double damping, scale;
    bool settled;
};

// Goes on from a state; evidence.A is at the end that of the state that is returned.
inline Searched calibrate_batch(SightingEvidence &evidence, const double *start, std::size_t n, double damping,
                                 std::int64_t steps, double least_fall, double most_damping) {
    const std::size_t length = state::points + 2 * n, m = evidence.size();
    std::vector<double> now(start, start + length), tried(length), step(m), damped;
    evidence.look(now.data());
    double scale = evidence.scale(0.0), cost = evidence.cost(scale);
    evidence.equations(now.data(), scale);
    bool settled = false;
    for (std::int64_t k = 0; k < steps && !settled; ++k) {
        damped = evidence.A;
        for (std::size_t i = 0; i < m; ++i) damped[i * m + i] += damping * evidence.A[i * m + i];
        Factors(damped, m).solve(evidence.b.data(), step.data());
        double found = std::numeric_limits<double>::infinity();
        if (!turns_too_far(step.data())) {
            stepped(now.data(), step.data(), n, tried.data());
            evidence.look(tried.data());
            found = evidence.cost(scale);
        }
        if (found <= cost) {
            settled = cost - found < least_fall;
            evidence.equations(tried.data(), scale);
            now.swap(tried);
            damping = std::max(damping / 5.0, 1e-9);
            if (!settled) scale = evidence.scale(scale);
            cost = evidence.cost(scale);
        } else {
            damping *= 10.0;
            settled = damping > most_damping;
        }
    }
    return {now, damping, scale, settled};
}

}  // namespace grasptrack
