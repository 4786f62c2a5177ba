// SPDX-License-Identifier: Apache-2.0
// What is told of a pose and its covariance.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "target.hpp"

namespace grasptrack::pose {

// Signed area of a polygon seen through G; NaN where part of it lies behind the camera, or G is none.
inline double seen_area(const Homography &G, const double *points, std::size_t n) {
    constexpr double before = 1e-6, none = std::numeric_limits<double>::quiet_NaN();
    for (double value : G)
        if (!std::isfinite(value)) return none;
    if (n == 0) return 0.0;
    const auto at = [&](std::size_t i) { return Point{points[2 * i], points[2 * i + 1]}; };
    for (std::size_t i = 0; i < n; ++i)
        if (!(G[6] * at(i).x + G[7] * at(i).y + G[8] > before)) return none;
    const Point first = carried(G, at(0).x, at(0).y);
    Point last{0.0, 0.0};  // from the first on: large coordinates take nothing away
    double sum = 0;
    for (std::size_t i = 1; i < n; ++i) {
        const Point q = carried(G, at(i).x, at(i).y), now{q.x - first.x, q.y - first.y};
        sum += last.x * now.y - last.y * now.x;
        last = now;
    }
    return 0.5 * sum;
}

struct Placed {
    Point at;
    std::array<double, 4> covariance;
};

// A work point in the image, and the covariance that the pose's error gives it.
inline Placed placed(const Target &target, const Homography &G, const Matrix<8> &P, Point work) {
    const auto J = target.jacobian(work.x, work.y);
    const auto D = derivatives(G, work.x, work.y);
    std::array<Vector<8>, 2> K;
    for (std::size_t k = 0; k < 8; ++k) {
        K[0][k] = D[0] * J[0][k] + D[1] * J[1][k];
        K[1][k] = D[2] * J[0][k] + D[3] * J[1][k];
    }
    Placed out{carried(G, work.x, work.y), {}};
    for (std::size_t p = 0; p < 2; ++p) {
        const Vector<8> row = times<8>(P, K[p]);
        for (std::size_t q = 0; q < 2; ++q)
            for (std::size_t k = 0; k < 8; ++k) out.covariance[q * 2 + p] += K[q][k] * row[k];
    }
    return out;
}

// The contacts in an image (x, y), their covariances (2, 2) and their mean.
struct Contacts {
    std::vector<double> places, covariances;
    Point middle{};
};

inline Contacts placed_contacts(const Target &target, const Homography &G, const Matrix<8> &P) {
    Contacts out;
    for (const Point &contact : target.contacts) {
        const Placed found = placed(target, G, P, contact);
        out.places.insert(out.places.end(), {found.at.x, found.at.y});
        out.covariances.insert(out.covariances.end(), found.covariance.begin(), found.covariance.end());
        out.middle.x += found.at.x;
        out.middle.y += found.at.y;
    }
    out.middle.x /= static_cast<double>(target.contacts.size());
    out.middle.y /= static_cast<double>(target.contacts.size());
    return out;
}

struct Joined {
    double distance = std::numeric_limits<double>::infinity();  // squared, of the two in their common covariance
    Homography G;
    Matrix<8> P;
};

// Two independent predictions of a pose as one; an infinite distance where there is none.
inline Joined joined(const Target &target, const Homography &G, const Matrix<8> &P, const Homography &other, const Matrix<8> &Q) {
    Joined out{std::numeric_limits<double>::infinity(), G, P};
    Vector<8> d;
    Matrix<8> sum, inverse;
    for (std::size_t k = 0; k < 64; ++k) sum[k] = P[k] + Q[k];
    if (!target.difference(G, other, d) || !invert<8>(sum, inverse)) return out;
    const Matrix<8> gain = times<8>(P, inverse), less = times<8>(gain, P);
    out.distance = quadratic<8>(inverse, d.data());
    out.G = target.moved(G, times<8>(gain, d));
    for (std::size_t i = 0; i < 8; ++i)
        for (std::size_t j = 0; j < 8; ++j) out.P[i * 8 + j] = 0.5 * (P[i * 8 + j] - less[i * 8 + j] + P[j * 8 + i] - less[j * 8 + i]);
    return out;
}

struct SurfaceNumbers {
    double match_spread, chance_spread;  // of a correlation, from 1 where the surface is the same, from 0 where it is not
    double independent;                  // patches that count as one
};

// Likelihood ratio of a patch's correlation: this surface, as it usually agrees, against another one.
inline double likeness(double r, double usual, double match2, double chance2) {
    const double u = std::clamp(usual, 0.0, 1.0), variance = u * u * match2 + (1 - u * u) * chance2;
    // what usually agrees little may agree by chance today, and not tomorrow
    return std::sqrt(chance2 / variance) * std::exp(0.5 * (r * r / chance2 - (r - u) * (r - u) / variance));
}

// Probabilities (n) that the patches of one level are the surface's own: their share is the one that makes what they show most
// probable. NaN of those that are not seen.
inline void surface_probability(const double *correlation, const double *usual, std::size_t n, double match, double chance, double *out) {
    constexpr int rounds = 4;
    double share = 0.5, seen = 0;
    for (std::size_t i = 0; i < n; ++i) {
        out[i] = likeness(correlation[i], usual[i], match * match, chance * chance);
        seen += std::isfinite(out[i]);
    }
    for (int round = 0; round < rounds && seen > 0; ++round) {
        double own = 0;
        for (std::size_t i = 0; i < n; ++i)
            if (std::isfinite(out[i])) own += share * out[i] / (share * out[i] + 1 - share);
        share = own / seen;
    }
    for (std::size_t i = 0; i < n; ++i) out[i] = share * out[i] / (share * out[i] + 1 - share);
}

// Log-likelihood ratios of one level's correlations, NaN where not seen: this surface, each share of it covered, against another one.
inline std::vector<double> level_evidence(const double *correlation, const double *usual, std::size_t n, const double *share,
                                          std::size_t m, const SurfaceNumbers &numbers) {
    std::vector<double> product(m, 1.0), sum(m, 0.0);
    const double chance2 = numbers.chance_spread * numbers.chance_spread, match2 = numbers.match_spread * numbers.match_spread;
    constexpr double far = 1e30;  // a product is taken to a logarithm before it is lost
    double least = 1, low = 1, high = 1;
    for (std::size_t k = 0; k < m; ++k) least = std::min(least, share[k]);
    const auto settle = [&] {
        for (std::size_t k = 0; k < m; ++k) {
            sum[k] += std::log(product[k]);
            product[k] = 1.0;
        }
        low = high = 1;
    };
    for (std::size_t i = 0; i < n; ++i) {
        const double r = correlation[i];
        if (!std::isfinite(r)) continue;
        const double ratio = likeness(r, usual[i], match2, chance2);
        low *= std::max(std::min(ratio, 1.0), least);
        high *= std::max(ratio, 1.0);
        for (std::size_t k = 0; k < m; ++k) product[k] *= (1 - share[k]) * ratio + share[k];
        if (!(low > 1 / far && high < far)) settle();
    }
    settle();
    for (double &value : sum) value /= numbers.independent;
    return sum;
}

struct SurfaceEvidence {
    double odds = 0;               // log-likelihood ratio, of each level with a share of its own
    std::vector<double> by_share;  // the same where all levels have one share
};

// The next level, n correlations, added to the evidence of those before. `log_prior`: of the m shares.
inline void add_level(SurfaceEvidence &out, const double *correlation, const double *usual, std::size_t n, const double *share,
                      const double *log_prior, std::size_t m, const SurfaceNumbers &numbers) {
    out.by_share.resize(m, 0.0);
    if (m == 0 || std::none_of(correlation, correlation + n, [](double r) { return std::isfinite(r); })) return;
    const std::vector<double> level = level_evidence(correlation, usual, n, share, m, numbers);
    double most = -std::numeric_limits<double>::infinity(), sum = 0;
    for (std::size_t k = 0; k < m; ++k) {
        out.by_share[k] += level[k];
        most = std::max(most, level[k] + log_prior[k]);
    }
    for (std::size_t k = 0; k < m; ++k) sum += std::exp(level[k] + log_prior[k] - most);
    out.odds += most + std::log(sum);
}

}  // namespace grasptrack::pose
