// SPDX-License-Identifier: Apache-2.0
// What edges tell of the pose beyond what noise in their normals seems to tell.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "camera.hpp"
#include "edges.hpp"
#include "matrix.hpp"

namespace grasptrack::pose {

// Eigenvalues of a symmetric matrix and its eigenvectors as columns, by Jacobi's rotations.
template <std::size_t N> std::pair<Vector<N>, Matrix<N>> eigen(Matrix<N> a) {
    Matrix<N> vectors = diagonal<N>(1.0);
    constexpr int sweeps = 30;
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        double off = 0, on = 0;
        for (std::size_t i = 0; i < N; ++i)
            for (std::size_t j = 0; j < N; ++j) (i == j ? on : off) += a[i * N + j] * a[i * N + j];
        if (!(off > 1e-30 * on)) break;
        for (std::size_t p = 0; p < N; ++p)
            for (std::size_t q = p + 1; q < N; ++q) {
                if (a[p * N + q] == 0.0) continue;
                const double theta = (a[q * N + q] - a[p * N + p]) / (2 * a[p * N + q]);
                const double t = (theta < 0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1));
                const double c = 1 / std::sqrt(t * t + 1), s = t * c;
                for (std::size_t k = 0; k < N; ++k) {
                    const double x = a[k * N + p], y = a[k * N + q];
                    a[k * N + p] = c * x - s * y;
                    a[k * N + q] = s * x + c * y;
                }
                for (std::size_t k = 0; k < N; ++k) {
                    const double x = a[p * N + k], y = a[q * N + k];
                    a[p * N + k] = c * x - s * y;
                    a[q * N + k] = s * x + c * y;
                    const double u = vectors[k * N + p], v = vectors[k * N + q];
                    vectors[k * N + p] = c * u - s * v;
                    vectors[k * N + q] = s * u + c * v;
                }
            }
    }
    Vector<N> values;
    for (std::size_t i = 0; i < N; ++i) values[i] = a[i * N + i];
    return {values, vectors};
}

// By which rows of the edges are to be multiplied from the right, transposed. Along a motion under which the outline stays on
// itself, as a disc turned, exact normals tell nothing; noise in them seems to tell all the same.
//
// own: the edges' information, of the pose and of the thickness. by_noise: what noise in their normals seems to tell of the pose, packed.
inline Matrix<9> beyond_noise(const Matrix<9> &own, const Packed<8> &by_noise) {
    constexpr std::size_t N = 8;
    Matrix<9> out = diagonal<9>(1.0);
    for (double value : own)
        if (!std::isfinite(value)) return out;
    Matrix<N> L, inverse;
    if (!cholesky<N>(unpacked<N>(by_noise), L, inverse)) return out;
    Matrix<N> lead;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) lead[i * N + j] = own[i * 9 + j];
    const auto [values, Q] = eigen<N>(times<N>(times<N>(inverse, lead), transposed<N>(inverse)));
    Matrix<N> scaled = transposed<N>(Q);
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) scaled[i * N + j] *= std::max(0.0, 1 - 1 / std::max(values[i], 1e-12));
    const Matrix<N> telling = times<N>(times<N>(times<N>(L, Q), scaled), inverse);
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t j = 0; j < N; ++j) out[i * 9 + j] = telling[i * N + j];
    return out;
}

// What is expected of the pose and allowed by a camera, as normal equations: priors, bounded perspective, a pinhole's view of a
// rigid plane, and what is not known of part and camera.

// Of grasptrack.tracking.numbers, where each is described, those that the estimator needs, by the same names.
struct Numbers {
    double edge_missed, same_sign, edge_floor, edge_noise, other_spread, share_object, share_occluded, share_other, stretch, sample_distance,
        wide, cell_unlikely, cell_far, cell_power, cell_cover, texture_floor, texture_independent, texture_freedom, prior_freedom, perspective,
        pinhole_sd, pinhole_freedom, tolerance, tolerance_px;
};

constexpr std::pair<const char *, double Numbers::*> number_names[] = {
    {"edge_missed", &Numbers::edge_missed}, {"same_sign", &Numbers::same_sign}, {"edge_floor", &Numbers::edge_floor},
    {"edge_noise", &Numbers::edge_noise}, {"other_spread", &Numbers::other_spread}, {"share_object", &Numbers::share_object},
    {"share_occluded", &Numbers::share_occluded}, {"share_other", &Numbers::share_other}, {"stretch", &Numbers::stretch},
    {"sample_distance", &Numbers::sample_distance}, {"wide", &Numbers::wide}, {"cell_unlikely", &Numbers::cell_unlikely},
    {"cell_far", &Numbers::cell_far}, {"cell_power", &Numbers::cell_power}, {"cell_cover", &Numbers::cell_cover},
    {"texture_floor", &Numbers::texture_floor}, {"texture_independent", &Numbers::texture_independent},
    {"texture_freedom", &Numbers::texture_freedom}, {"prior_freedom", &Numbers::prior_freedom},
    {"perspective", &Numbers::perspective}, {"pinhole_sd", &Numbers::pinhole_sd}, {"pinhole_freedom", &Numbers::pinhole_freedom},
    {"tolerance", &Numbers::tolerance}, {"tolerance_px", &Numbers::tolerance_px},
};

struct Start {
    Homography G;
    Matrix<8> P;
    Homography last;           // the pose in the frame before, for the speed
    Bend bend;                 // see there
    double readout;            // share of the time between two images in which rows are read out, as it is believed
    Nuisance nuisance;
    Matrix<nuisances> nuisance_covariance;
    double sides;              // see EdgeNumbers
    double inner_spread;       // grey levels
    double reach;              // work px; 0: from the covariance
    double edge_width;         // work px, standard deviation of an edge at rest
    double blur_share;         // of what moved across an edge since the last image: half of its blur
    Light light;               // of the surface, where it was located last
    Frame frame;               // of the image
    Vector<8> lag;             // variances of the pose's error that all patches share; infinite: the texture is only looked at
};

// Normal equations of the pose's error and of what else is not known, the latter as it is, not its error.
constexpr std::size_t unknowns = 8 + nuisances;
struct System {
    Matrix<unknowns> A{};
    Vector<unknowns> b{};
    Matrix<8> prior{};  // of it, what was expected of the pose
    Vector<8> expected{};
};

// What was believed before an image, as information.
struct Beliefs {
    Matrix<8> pose{};
    Matrix<nuisances> nuisance{};
};

// Priors, bounded perspective and pinhole as normal equations about the pose G and what is taken for the nuisances there.
inline bool system_about(const Target &target, const Start &start, const Numbers &numbers, const Beliefs &beliefs, const Homography &G,
                         const Nuisance &nuisance, System &out) {
    Vector<8> d;
    if (!target.difference(start.G, G, d)) return false;
    const double distance = quadratic<8>(beliefs.pose, d.data());
    const double heavy = (numbers.prior_freedom + 8) / (numbers.prior_freedom + std::max(8.0, distance));
    Matrix<8> own = beliefs.pose;
    for (double &value : own) value *= heavy;
    Vector<8> toward = times<8>(own, d);
    for (double &value : toward) value = -value;
    add_rows<8>(out.A, out.b, own, toward);
    out.prior = own;
    out.expected = toward;
    const Nuisance &believed = start.nuisance;
    for (std::size_t i = 0; i < nuisances; ++i)
        for (std::size_t j = 0; j < nuisances; ++j) {
            out.A[(8 + i) * unknowns + 8 + j] = beliefs.nuisance[i * nuisances + j];
            out.b[8 + i] += beliefs.nuisance[i * nuisances + j] * believed[j];
        }
    // perspective terms against the first view, in work px at the half size
    const double r = target.radius;
    const double g = G[6] * r, hh = G[7] * r, w = G[6] * target.cx + G[7] * target.cy + G[8];
    const double z[2] = {-g / w * r, -hh / w * r};
    const double i = 1.0 / (numbers.perspective * r * numbers.perspective * r);
    for (std::size_t k = 0; k < 2; ++k) {
        out.A[(6 + k) * unknowns + 6 + k] += i;
        out.b[6 + k] -= i * z[k];
    }
    // what a readout makes of the pose, no camera that sees all rows at once would show
    Vector<8> all_at_once = start.bend[0];
    for (double &value : all_at_once) value *= start.readout;
    const PinholeRows pin = pinhole_rows(target, target.moved(G, all_at_once), {nuisance[1], nuisance[2], nuisance[3]}, start.frame);
    if (!pin.valid) return true;
    // both rows by all unknowns, with the misfit where the nuisances are 0, and where they are as they were believed
    std::array<Vector<unknowns>, 2> J{};
    double rest[2], off[2], c[4];
    const double own_variance = numbers.pinhole_sd * numbers.pinhole_sd;
    for (std::size_t p = 0; p < 2; ++p) {
        rest[p] = pin.misfit[p];
        for (std::size_t k = 0; k < 8; ++k) J[p][k] = pin.by_pose[p][k];
        for (std::size_t k = 0; k < 3; ++k) {
            J[p][9 + k] = pin.by_camera[p][k];
            rest[p] -= pin.by_camera[p][k] * nuisance[1 + k];
        }
        off[p] = rest[p];
        for (std::size_t k = 0; k < 3; ++k) off[p] += pin.by_camera[p][k] * believed[1 + k];
    }
    for (std::size_t p = 0; p < 2; ++p)
        for (std::size_t q = 0; q < 2; ++q) {
            c[p * 2 + q] = p == q ? own_variance : 0.0;
            for (std::size_t m = 0; m < 3; ++m)
                for (std::size_t k = 0; k < 3; ++k)
                    c[p * 2 + q] += pin.by_camera[p][m] * start.nuisance_covariance[(1 + m) * nuisances + 1 + k] * pin.by_camera[q][k];
        }
    const double det = c[0] * c[3] - c[1] * c[2];
    const double far = (off[0] * (c[3] * off[0] - c[1] * off[1]) + off[1] * (c[0] * off[1] - c[2] * off[0])) / det;
    const double weight = (numbers.pinhole_freedom + 2) / (numbers.pinhole_freedom + std::max(2.0, far)) / own_variance;
    for (std::size_t p = 0; p < 2; ++p)
        for (std::size_t a = 0; a < unknowns; ++a) {
            out.b[a] -= weight * J[p][a] * rest[p];
            for (std::size_t q = 0; q < unknowns; ++q) out.A[a * unknowns + q] += weight * J[p][a] * J[p][q];
        }
    return true;
}

// Of scores that are correlated with their neighbours: Newey and West along the outline.
template <std::size_t N> Matrix<N> scatter_of(const std::vector<Vector<N>> &scores) {
    const std::size_t n = scores.size();
    const std::size_t lags = std::max<std::size_t>(3, static_cast<std::size_t>(0.06 * static_cast<double>(n)));
    const auto before = [n](std::size_t i, std::size_t q) { return (i + n - q % n) % n; };
    Vector<N> near{}, plain{};  // sums of the scores before a sample, as far as they count: triangular, and all alike
    for (std::size_t q = 1; q < lags; ++q)
        for (std::size_t k = 0; k < N; ++k) {
            const double score = scores[before(0, q)][k];
            near[k] += (1.0 - static_cast<double>(q) / static_cast<double>(lags)) * score;
            plain[k] += score;
        }
    Matrix<N> half{};  // the scatter is this and its transpose
    const double share = 1.0 / static_cast<double>(lags);
    for (std::size_t i = 0; i < n; ++i) {
        const Vector<N> &own = scores[i], &last = scores[before(i, lags - 1)];
        Vector<N> with;
        for (std::size_t k = 0; k < N; ++k) with[k] = 0.5 * own[k] + near[k];
        for (std::size_t a = 0; a < N; ++a)
            for (std::size_t c = 0; c < N; ++c) half[a * N + c] += own[a] * with[c];
        for (std::size_t k = 0; k < N; ++k) {  // those of the next sample
            near[k] += own[k] - share * (own[k] + plain[k]);
            plain[k] += own[k] - last[k];
        }
    }
    Matrix<N> scatter;
    for (std::size_t a = 0; a < N; ++a)
        for (std::size_t c = 0; c < N; ++c) scatter[a * N + c] = half[a * N + c] + half[c * N + a];
    return scatter;
}

// A covariance with what correlated residuals of the edges add to it.
inline void add_correlated(Matrix<unknowns> &P, const Matrix<9> &scatter) {
    Matrix<unknowns> wide{};
    for (std::size_t a = 0; a < 9; ++a)
        for (std::size_t c = 0; c < 9; ++c) wide[a * unknowns + c] = scatter[a * 9 + c];
    const Matrix<unknowns> more = times<unknowns>(times<unknowns>(P, wide), P);
    for (std::size_t k = 0; k < unknowns * unknowns; ++k) P[k] += more[k];
    for (std::size_t a = 0; a < unknowns; ++a)
        for (std::size_t c = 0; c < a; ++c)
            P[a * unknowns + c] = P[c * unknowns + a] = 0.5 * (P[a * unknowns + c] + P[c * unknowns + a]);
}

inline double bounded_nuisance(std::size_t k, double value) {
    return k == 0 ? (value < 0 ? 0.0 : value) : std::clamp(value, -most_theta, most_theta);
}

// What the image itself tells of the nuisances: a pose that was expected has what was believed of them in it, which must not
// confirm itself.
inline bool learned_nuisances(System system, const Matrix<9> &scatter, double radius, Nuisance &nuisance, Matrix<nuisances> &covariance) {
    const double open = 1.0 / (radius * radius);
    for (std::size_t i = 0; i < 8; ++i) {
        system.b[i] -= system.expected[i];
        for (std::size_t j = 0; j < 8; ++j) system.A[i * unknowns + j] -= system.prior[i * 8 + j] - (i == j ? open : 0.0);
    }
    Matrix<unknowns> all;
    if (!invert<unknowns>(system.A, all)) return false;
    const Vector<unknowns> x = times<unknowns>(all, system.b);
    add_correlated(all, scatter);
    covariance = block<unknowns, nuisances>(all, 8);
    for (std::size_t k = 0; k < nuisances; ++k) nuisance[k] = bounded_nuisance(k, x[8 + k]);
    return true;
}

}  // namespace grasptrack::pose
