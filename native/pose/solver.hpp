// SPDX-License-Identifier: Apache-2.0
// One hypothesis of the pose, made exact: Gauss-Newton on edges, texture, thickness and what a pinhole allows, with a
// prior of heavy tails; and the evidence for it. The NumPy definition is grasptrack.kernels.reference_pose.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "camera.hpp"
#include "chain.hpp"
#include "edges.hpp"
#include "regions.hpp"
#include "texture.hpp"
#include "wide.hpp"

namespace grasptrack::pose {

struct Numbers {
    double miss, same_sign, edge_floor, edge_noise, other_spread;
    double share_object, share_occluded, share_other, stretch;
    double texture_floor, texture_independent, texture_freedom, texture_spread;
    double prior_freedom, perspective, pinhole_sd, pinhole_freedom;
    double sample_distance;  // work px of the outline that carry one independent measurement
    double wide;             // of the size: how far round the answer edges are looked for
    double cell_unlikely, cell_far, cell_power, cell_cover;
    double tolerance, tolerance_px, risk;
};

struct Start {
    Homography G;
    Matrix<8> P;
    Homography last;           // the pose in the frame before, for the speed
    Vector<3> theta;
    Matrix<3> theta_covariance;
    double thickness, thickness_variance;  // work px, work px^2
    double inner_spread;       // grey levels
    double reach;              // work px; 0: from the covariance
    double edge_width;         // work px, standard deviation of an edge at rest
    double blur_share;         // of what moved across an edge since the last image: half of its blur
    Light light;               // of the surface, where it was located last
    double width, height;      // px of the image
};

struct Solution {
    bool valid = false;
    Homography G{};
    Matrix<8> P{};
    double thickness = 0, thickness_variance = 0;
    Light light;
    // work px, standard deviation of an edge at rest, and half of what blurs it, of what moved across it; NaN of few
    double edge_width = std::numeric_limits<double>::quiet_NaN(), blur_share = edge_width;
    double blur = edge_width;  // work px, half of what blurs all but a quarter of the edges; NaN of few
    double edge_share = 0, edge_sigma = 0, look = 0;  // look: median grey difference of the inner side where the edge is seen
    int texture_used = 0;
    double texture_agreeing = 0, texture_spread = 0;
    std::vector<std::vector<double>> correlation;  // of each patch of the three finest levels; NaN outside the image
    std::vector<double> visible;      // of each sample: probability that the object's own edge was seen there
    std::vector<double> occluded, other;
    double log_odds = 0;     // of the outline: this object, partly occluded, against no such object
    double elsewhere = 0;    // share of the outline whose edge lies elsewhere
    double astray = 0;       // of that, farther away than a pose that is believed may be off
    double other_shape = 0;  // log-likelihood ratio of another shape
    std::vector<double> differs;
};

class Solver {
  public:
    Solver(const Target &target, const Pyramid &pyramid, const Start &start, const Numbers &numbers)
        : target_(target), pyramid_(pyramid), start_(start), numbers_(numbers) {
        const std::size_t n = target.points.size();
        power_ = 0;
        if (n > 0) power_ = std::min(1.0, spacing() / numbers.sample_distance);
    }

    Solution solve() {
        Solution out;
        if (!invert<8>(start_.P, prior_)) return out;
        Homography G = start_.G;
        if (!texture_alone(G)) return out;
        Matrix<8> P = start_.P;
        const bool edges = target_.points.size() >= 30;
        double h = start_.thickness, vh = start_.thickness_variance;
        const int first = whole(start_.reach, 0, farthest);
        int reach = first;
        constexpr int rounds = 8, direct = 4;
        Vector<8> last{};
        bool done = false;
        for (int round = 0; round < rounds && !done; ++round) {
            Matrix<8> A;
            Vector<8> b;
            if (!system(G, A, b)) return out;
            TextureFit texture = texture_rows(G, A, b, out);
            for (std::size_t k = 0; k < 64; ++k) A[k] += texture.information[k];
            for (std::size_t k = 0; k < 8; ++k) b[k] += texture.gradient[k];
            if (!invert<8>(A, P)) return out;
            Vector<8> d = times<8>(P, b);
            out.light = surface_light(target_, pyramid_, G, start_.light);
            if (edges) {
                if (reach == 0 || round == 0) {
                    const int own = reach_of(P, 2.5, 3.0);
                    reach = round == 0 && start_.reach > 0 ? first : own;
                }
                const std::vector<int> half = half_widths(G);
                view_ = measure_edges(target_, pyramid_, G, reach, half, out.light, 46);
                if (!fit_edges(round == 0 ? 3 : 4, G, A, b, d, P, h, vh, out)) return out;
            }
            // what does not settle goes to and fro between two answers
            for (double &value : d) value = std::clamp(round < direct ? value : 0.5 * value, -target_.radius, target_.radius);
            const double moved = contacts_moved(d);
            G = target_.moved(G, d);
            if (!finite(G)) return out;
            if (edges) reach = whole(reach_of(P, 3.0, 3.0) + moved, 4, 30);
            last = d;
            done = moved < settled && round > 0;
            // after the first few, what moves by less than half its own standard deviation is not worth another
            if (round + 1 >= direct && moved < 0.5 * contacts_deviation(P)) break;
        }
        if (!done) patches_ = match_all(0, told, G);  // else the last step moved none of them
        // an answer that still moves is not known better than by its last step
        for (std::size_t a = 0; a < 8; ++a)
            for (std::size_t c = 0; c < 8; ++c) P[a * 8 + c] += last[a] * last[c];
        out.G = G;
        out.P = P;
        out.thickness = h;
        out.thickness_variance = vh;
        out.valid = true;
        judge(out, edges, h, vh);
        return out;
    }

  private:
    static constexpr std::size_t told = 3;   // levels of texture, the finest, that are told of; the coarser of them where blur has taken the finest
    static constexpr double settled = 0.02;  // work px: a step that moves no contact by more is the last
    static constexpr double exact = 0.002;   // the same where edges are weighed anew

    // Work px, standard deviation of a contact along an axis at most, by the covariance P of the pose's error.
    double contacts_deviation(const Matrix<8> &P) const {
        const Form<8> spread(P);
        double most = 0;
        for (const Point &p : target_.contacts)
            for (const auto &row : target_.jacobian(p.x, p.y)) most = std::max(most, spread(outer<8>(row)));
        return std::sqrt(most);
    }

    // Work px by which the pose's error d moves a contact at most, along an axis.
    double contacts_moved(const Vector<8> &d) const {
        double moved = 0;
        for (const Point &p : target_.contacts)
            for (const auto &row : target_.jacobian(p.x, p.y)) {
                double sum = 0;
                for (std::size_t k = 0; k < 8; ++k) sum += row[k] * d[k];
                moved = std::max(moved, std::abs(sum));
            }
        return moved;
    }

    double spacing() const {  // mean distance of neighbouring samples
        const std::size_t n = target_.points.size();
        if (n < 2) return 1.0;
        std::vector<double> gaps(n);
        for (std::size_t i = 0; i < n; ++i) {
            const Point a = target_.points[i], b = target_.points[(i + 1) % n];
            gaps[i] = std::hypot(a.x - b.x, a.y - b.y);
        }
        return middle(gaps);
    }

    static bool finite(const Homography &G) {
        for (double v : G)
            if (!std::isfinite(v)) return false;
        return true;
    }

    // Prior, bounded perspective and pinhole as normal equations about the pose G.
    bool system(const Homography &G, Matrix<8> &A, Vector<8> &b) const {
        Vector<8> d;
        if (!target_.difference(start_.G, G, d)) return false;
        const double distance = quadratic<8>(prior_, d.data());
        const double heavy = (numbers_.prior_freedom + 8) / (numbers_.prior_freedom + std::max(8.0, distance));
        A = prior_;
        for (double &value : A) value *= heavy;
        b = times<8>(A, d);
        for (double &value : b) value = -value;
        // perspective terms against the first view, in work px at the half size
        const double r = target_.radius;
        const double g = G[6] * r, hh = G[7] * r, w = G[6] * target_.cx + G[7] * target_.cy + G[8];
        const double z[2] = {-g / w * r, -hh / w * r};
        const double i = 1.0 / (numbers_.perspective * r * numbers_.perspective * r);
        for (std::size_t k = 0; k < 2; ++k) {
            A[(6 + k) * 8 + 6 + k] += i;
            b[6 + k] -= i * z[k];
        }
        const PinholeRows pin = pinhole_rows(target_, G, start_.theta, start_.width, start_.height);
        if (pin.valid) {
            // covariance of the misfit: what is not known of the camera, and how far real ones are from the model
            double c[4];
            for (std::size_t p = 0; p < 2; ++p)
                for (std::size_t q = 0; q < 2; ++q) {
                    double sum = p == q ? numbers_.pinhole_sd * numbers_.pinhole_sd : 0.0;
                    for (std::size_t m = 0; m < 3; ++m)
                        for (std::size_t k = 0; k < 3; ++k)
                            sum += pin.by_camera[p][m] * start_.theta_covariance[m * 3 + k] * pin.by_camera[q][k];
                    c[p * 2 + q] = sum;
                }
            const double det = c[0] * c[3] - c[1] * c[2];
            double W[4] = {c[3] / det, -c[1] / det, -c[2] / det, c[0] / det};
            const double e0 = pin.misfit[0], e1 = pin.misfit[1];
            const double m2 = e0 * (W[0] * e0 + W[1] * e1) + e1 * (W[2] * e0 + W[3] * e1);
            const double weight = (numbers_.pinhole_freedom + 2) / (numbers_.pinhole_freedom + std::max(2.0, m2));
            for (double &value : W) value *= weight;
            for (std::size_t a = 0; a < 8; ++a) {
                const double k0 = W[0] * pin.by_pose[0][a] + W[2] * pin.by_pose[1][a];
                const double k1 = W[1] * pin.by_pose[0][a] + W[3] * pin.by_pose[1][a];
                for (std::size_t q = 0; q < 8; ++q) A[a * 8 + q] += k0 * pin.by_pose[0][q] + k1 * pin.by_pose[1][q];
                b[a] -= k0 * e0 + k1 * e1;
            }
        }
        return true;
    }

    TextureNumbers texture_numbers() const {
        return {numbers_.texture_floor, numbers_.texture_independent, numbers_.texture_freedom};
    }

    // All patches of the levels from `first` to `end`.
    std::vector<PatchRow> match_all(std::size_t first, std::size_t end, const Homography &G) const {
        std::vector<PatchRow> rows;
        for (std::size_t level = first; level < std::min(end, target_.texture.size()); ++level) {
            const PatchSet &set = target_.texture[level];
            for (const Patch &patch : set.patches)
                rows.push_back({&patch, match_patch(pyramid_, G, patch, set.stride, target_.noise, numbers_.texture_floor * set.stride)});
        }
        return rows;
    }

    // Coarse to fine on the texture, before edges are looked at: their candidates are many, its valley is wide.
    bool texture_alone(Homography &G) const {
        double far = 0;  // work px within which the pose is known
        for (const Point &p : target_.contacts) {
            const auto J = target_.jacobian(p.x, p.y);
            for (const auto &row : J) far = std::max(far, std::sqrt(quadratic<8>(start_.P, row.data())));
        }
        for (std::size_t level = target_.texture.size(); level-- > 0;) {
            const PatchSet &set = target_.texture[level];
            if (set.patches.size() < 4 || (level > 0 && far < set.stride)) continue;
            for (int round = 0; round < 3; ++round) {
                Matrix<8> A, P;
                Vector<8> b;
                if (!system(G, A, b)) break;
                const TextureFit fit_and = fit_patches(match_all(level, level + 1, G), A, b, texture_numbers());
                if (!telling(fit_and, set.patches.size())) break;
                for (std::size_t k = 0; k < 64; ++k) A[k] += fit_and.information[k];
                for (std::size_t k = 0; k < 8; ++k) b[k] += fit_and.gradient[k];
                if (!invert<8>(A, P)) return false;
                const Vector<8> d = times<8>(P, b);
                G = target_.moved(G, d);
                if (!finite(G)) return false;
                double most = 0;
                for (double value : d) most = std::max(most, std::abs(value));
                if (most < 0.3 * set.stride) break;
            }
        }
        return true;
    }

    static bool telling(const TextureFit &fit, std::size_t count) {
        // noise alone agrees here and there
        constexpr double least = 4, chance = 0.12;
        const auto n = static_cast<double>(count);
        return fit.used >= 4 && fit.agreeing * n >= least + chance * n;
    }

    TextureFit texture_rows(const Homography &G, const Matrix<8> &A, const Vector<8> &b, Solution &out) {
        TextureFit none;
        patches_ = match_all(0, told, G);
        if (patches_.size() < 4) return none;
        TextureFit fit = fit_patches(patches_, A, b, texture_numbers());
        out.texture_used = fit.used;
        out.texture_agreeing = fit.agreeing;
        out.texture_spread = fit.spread;
        return telling(fit, patches_.size()) ? fit : none;
    }

    int reach_of(const Matrix<8> &P, double times_sd, double more) const {
        double most = 0;
        const Form<8> spread(P);
        for (const auto &square : target_.squares) most = std::max(most, spread(square));
        return whole(times_sd * std::sqrt(most) + more, 4, 30);
    }

    // Work px that moved across each sample's edge since the image before.
    std::vector<double> moved_across(const Homography &G) const {
        const std::size_t n = target_.points.size();
        std::vector<double> moved(n, 0.0);
        Homography inverse;
        if (!invert_homography(G, inverse)) return moved;
        const Homography back = times<3>(inverse, start_.last);
        for (std::size_t i = 0; i < n; ++i) {
            const Point p = target_.points[i], m = target_.normals[i], q = carried(back, p.x, p.y);
            const double speed = std::abs((q.x - p.x) * m.x + (q.y - p.y) * m.y);
            if (speed == speed) moved[i] = speed;
        }
        return moved;
    }

    // Half of what moves across each sample's edge while it is exposed.
    std::vector<double> motion_blur(const Homography &G) const {
        std::vector<double> blur = moved_across(G);
        for (double &value : blur) value *= start_.blur_share;
        return blur;
    }

    // As far as an edge reaches: two standard deviations of it at rest, and the way that it moves.
    std::vector<int> half_widths(const Homography &G) const {
        const int rest = whole(2 * start_.edge_width, least_half, most_half);
        std::vector<int> half;
        for (double blur : motion_blur(G)) half.push_back(whole(rest + blur, least_half, most_half));
        return half;
    }

    // How wide the edges are that are seen, where next to nothing moves across them, and what motion adds where much does.
    // Half of what blurs each edge, as far as it moved, or where that is not known as wide as most edges are.
    std::vector<double> learn_widths(const Homography &G, const std::vector<double> &seen, Solution &out) const {
        constexpr double still = 1.0, fast = 4.0;  // work px, standard deviations at rest
        constexpr double blurred = 0.6267;         // sqrt(pi / 8): what `edge_width` makes of a ramp, of its half length
        constexpr std::size_t few = 20;
        const std::vector<double> &width = view_.width;
        const std::vector<double> moved = moved_across(G);
        const bool known = start_.last[0] == start_.last[0];
        std::vector<double> rest, share, half;
        for (std::size_t i = 0; i < width.size(); ++i) {
            if (!(seen[i] > 0.5) || width[i] != width[i]) continue;
            if (moved[i] < still) rest.push_back(width[i]);
            const double more = width[i] * width[i] - start_.edge_width * start_.edge_width;
            half.push_back(std::sqrt(std::max(0.0, more)) / blurred);
            if (moved[i] > fast * start_.edge_width && moved[i] > still) share.push_back(half.back() / moved[i]);
        }
        if (share.size() > few) out.blur_share = std::min(1.0, middle(share));
        if (known && rest.size() > few) out.edge_width = middle(rest);
        if (half.size() > few) {
            std::sort(half.begin(), half.end());
            out.blur = half[half.size() * 3 / 4];
            if (!known) return std::vector<double>(width.size(), out.blur);
        }
        return motion_blur(G);
    }

    States shares() const { return {numbers_.share_object, numbers_.share_occluded, numbers_.share_other}; }
    double stay() const { return std::exp(-1.0 / (numbers_.stretch * static_cast<double>(target_.points.size()))); }
    EdgeNumbers edge_numbers() const {
        return {numbers_.miss, numbers_.same_sign, numbers_.edge_floor, start_.inner_spread, numbers_.other_spread};
    }

    // Edges and thickness, by expectation and maximisation: which candidate, then the pose, `rounds` times at most.
    GRASPTRACK_WIDE bool fit_edges(int rounds, const Homography &G, const Matrix<8> &A, const Vector<8> &b, Vector<8> &d, Matrix<8> &P, double &h, double &vh,
                   Solution &out) {
        const std::size_t n = target_.points.size();
        const std::vector<double> parallax = lower_face(G);
        const double h0 = start_.thickness, v0 = start_.thickness_variance;
        std::vector<double> shift(n), low(n), low_variance(n), weight(n), seen_up(n), seen_low(n), sorted;
        edge_odds(target_, view_, edge_numbers(), odds_);
        // of an outline there is one explanation a round; that it lies elsewhere is as likely in all of them
        explained_.resize(n);
        for (std::size_t i = 0; i < n; ++i) explained_[i] = {1.0, 1.0, std::pow(odds_.other[i], power_)};
        Vector<8> last = d;
        for (int round = 0; round < rounds; ++round) {
            Vector<8> change;
            for (std::size_t k = 0; k < 8; ++k) change[k] = d[k] - last[k];
            if (round > 1 && contacts_moved(change) < exact) break;
            last = d;
            for (std::size_t i = 0; i < n; ++i) {
                shift[i] = 0;
                for (std::size_t k = 0; k < 8; ++k) shift[i] += target_.rows[i][k] * d[k];
                low[i] = parallax[i] * h;
                low_variance[i] = parallax[i] * parallax[i] * vh;
            }
            edge_likelihoods(target_, view_, odds_, shift, low, low_variance, P, edge_numbers(), likelihoods_);
            for (std::size_t i = 0; i < n; ++i) explained_[i][0] = std::pow(likelihoods_.object[i], power_);
            explain(explained_, shares(), stay(), true, 1.0, chain_);
            sorted.clear();
            for (std::size_t i = 0; i < n; ++i) {
                const double own = chain_.posterior[i][0];
                seen_up[i] = likelihoods_.upper[i] * own;
                seen_low[i] = likelihoods_.lower[i] * own;
                const double up = likelihoods_.upper_offset[i] - shift[i];
                const double down = likelihoods_.lower_offset[i] - shift[i] - low[i];
                if (seen_up[i] + seen_low[i] > 0.5) sorted.push_back(std::abs(seen_up[i] > seen_low[i] ? up : down));
            }
            double variance = 4.0;
            if (sorted.size() > 10) {
                const double mad = 1.4826 * middle(sorted);
                variance = numbers_.edge_noise * numbers_.edge_noise + mad * mad;
            }
            Packed<8> sum{};
            Vector<8> toward{}, across{};  // `across`: with the thickness, the ninth unknown
            double thick = 0, thick_toward = 0;
            for (std::size_t i = 0; i < n; ++i) {
                const double up = likelihoods_.upper_offset[i] - shift[i];
                const double down = likelihoods_.lower_offset[i] - shift[i] - low[i];
                const double wu = seen_up[i] / variance * power_ / (1 + up * up / (9 * variance));
                const double wl = seen_low[i] / variance * power_ / (1 + down * down / (9 * variance));
                weight[i] = wu + wl;
                const double u = wu > 1e-9 ? wu : 0.0, l = wl > 1e-9 ? wl : 0.0;
                if (!(u + l > 0)) continue;
                const Vector<8> &J = target_.rows[i];
                const Packed<8> &square = target_.squares[i];
                for (std::size_t k = 0; k < square.size(); ++k) sum[k] += (u + l) * square[k];
                const double drawn = u * likelihoods_.upper_offset[i] + l * likelihoods_.lower_offset[i], shared = l * parallax[i];
                for (std::size_t a = 0; a < 8; ++a) {
                    toward[a] += drawn * J[a];
                    across[a] += shared * J[a];
                }
                thick += shared * parallax[i];
                thick_toward += shared * likelihoods_.lower_offset[i];
            }
            const Matrix<8> own = unpacked<8>(sum);
            Matrix<9> A9, P9;
            Vector<9> b9;
            for (std::size_t a = 0; a < 8; ++a) {
                for (std::size_t c = 0; c < 8; ++c) A9[a * 9 + c] = A[a * 8 + c] + own[a * 8 + c];
                A9[a * 9 + 8] = A9[72 + a] = across[a];
                b9[a] = b[a] + toward[a];
            }
            A9[80] = 1.0 / v0 + thick;
            b9[8] = h0 / v0 + thick_toward;
            if (!invert<9>(A9, P9)) return false;
            const Vector<9> x = times<9>(P9, b9);
            for (std::size_t a = 0; a < 8; ++a) {
                d[a] = x[a];
                for (std::size_t c = 0; c < 8; ++c) P[a * 8 + c] = P9[a * 9 + c];
            }
            h = std::max(0.0, x[8]);
            vh = P9[80];
            out.edge_sigma = std::sqrt(variance);
        }
        std::vector<Vector<8>> scores(n);
        double share = 0;
        sorted.clear();
        for (std::size_t i = 0; i < n; ++i) {
            double residual = seen_up[i] > seen_low[i] ? likelihoods_.upper_offset[i] : likelihoods_.lower_offset[i] - parallax[i] * h;
            for (std::size_t k = 0; k < 8; ++k) residual -= target_.rows[i][k] * d[k];
            for (std::size_t k = 0; k < 8; ++k) scores[i][k] = weight[i] * residual * target_.rows[i][k];
            share += seen_up[i] + seen_low[i];
            if (seen_up[i] + seen_low[i] > 0.5) {
                double least = 1e9;
                for (int c = 0; c < view_.samples[i].count; ++c)
                    least = std::min(least, view_.samples[i].difference[static_cast<std::size_t>(c)]);
                sorted.push_back(std::sqrt(least));
            }
        }
        out.edge_share = share / static_cast<double>(n);
        out.look = 0;
        if (sorted.size() > 20) out.look = middle(sorted);
        add_correlated(P, scores);
        return true;
    }

    // The covariance P with what correlated residuals add: Newey and West along the outline.
    static void add_correlated(Matrix<8> &P, const std::vector<Vector<8>> &scores) {
        const std::size_t n = scores.size();
        const std::size_t lags = std::max<std::size_t>(3, static_cast<std::size_t>(0.06 * static_cast<double>(n)));
        const auto before = [n](std::size_t i, std::size_t q) { return (i + n - q % n) % n; };
        Vector<8> near{}, plain{};  // sums of the scores before a sample, as far as they count: triangular, and all alike
        for (std::size_t q = 1; q < lags; ++q)
            for (std::size_t k = 0; k < 8; ++k) {
                const double score = scores[before(0, q)][k];
                near[k] += (1.0 - static_cast<double>(q) / static_cast<double>(lags)) * score;
                plain[k] += score;
            }
        Matrix<8> half{};  // the scatter is this and its transpose
        const double share = 1.0 / static_cast<double>(lags);
        for (std::size_t i = 0; i < n; ++i) {
            const Vector<8> &own = scores[i], &last = scores[before(i, lags - 1)];
            Vector<8> with;
            for (std::size_t k = 0; k < 8; ++k) with[k] = 0.5 * own[k] + near[k];
            for (std::size_t a = 0; a < 8; ++a)
                for (std::size_t c = 0; c < 8; ++c) half[a * 8 + c] += own[a] * with[c];
            for (std::size_t k = 0; k < 8; ++k) {  // those of the next sample
                near[k] += own[k] - share * (own[k] + plain[k]);
                plain[k] += own[k] - last[k];
            }
        }
        Matrix<8> scatter;
        for (std::size_t a = 0; a < 8; ++a)
            for (std::size_t c = 0; c < 8; ++c) scatter[a * 8 + c] = half[a * 8 + c] + half[c * 8 + a];
        const Matrix<8> more = times<8>(times<8>(P, scatter), P);
        for (std::size_t k = 0; k < 64; ++k) P[k] += more[k];
        for (std::size_t a = 0; a < 8; ++a)
            for (std::size_t c = 0; c < a; ++c) P[a * 8 + c] = P[c * 8 + a] = 0.5 * (P[a * 8 + c] + P[c * 8 + a]);
    }

    std::vector<double> lower_face(const Homography &G) const {
        const Pinhole camera(target_, start_.theta, start_.width, start_.height);
        std::vector<double> now = camera.lower_face(target_, G);
        const std::vector<double> &first = first_sides(camera);
        for (std::size_t i = 0; i < now.size(); ++i) now[i] -= first[i];  // sides that the first view showed count the other way
        return now;
    }

    const std::vector<double> &first_sides(const Pinhole &camera) const {
        if (first_sides_.empty()) first_sides_ = camera.lower_face(target_, target_.A);
        return first_sides_;
    }

    // The evidence at the answer, edges looked for much farther away than the answer's own uncertainty.
    void judge(Solution &out, bool edges, double h, double vh) {
        const std::size_t n = target_.points.size();
        out.visible.assign(n, 0.0);
        out.occluded.assign(n, 0.0);
        out.other.assign(n, 0.0);
        if (edges) {
            const int reach = whole(numbers_.wide * 2 * target_.radius, 0, farthest);
            view_ = measure_edges(target_, pyramid_, out.G, reach, half_widths(out.G), out.light, 46, true);
            const std::vector<double> parallax = lower_face(out.G), none(n, 0.0);
            std::vector<double> low(n), variance(n);
            for (std::size_t i = 0; i < n; ++i) {
                low[i] = parallax[i] * h;
                variance[i] = parallax[i] * parallax[i] * vh;
            }
            edge_odds(target_, view_, edge_numbers(), odds_);
            edge_likelihoods(target_, view_, odds_, none, low, variance, out.P, edge_numbers(), likelihoods_);
            const EdgeLikelihoods &found = likelihoods_;
            explained_.resize(n);
            for (std::size_t i = 0; i < n; ++i) explained_[i] = {std::pow(found.object[i], power_), 1.0, std::pow(odds_.other[i], power_)};
            explain(explained_, shares(), stay(), true, 1.0, chain_);
            const Chain &here = chain_;
            for (States &state : explained_) state[0] = 1.0;
            std::vector<double> upper(n);
            States share = shares();
            share[2] += share[0];
            share[0] = 1e-12;
            const double total = share[0] + share[1] + share[2];
            for (double &value : share) value /= total;
            Chain without;
            explain(explained_, share, stay(), false, 1.0, without);
            out.log_odds = here.log_likelihood - without.log_likelihood;
            const double allowed = std::max(numbers_.tolerance_px, numbers_.tolerance * 2 * target_.radius);
            const double sigma = allowed / std::sqrt(-2 * std::log(numbers_.risk));  // of a contact that is still believed
            double elsewhere = 0, astray = 0;
            for (std::size_t i = 0; i < n; ++i) {
                out.visible[i] = here.posterior[i][0] * (found.upper[i] + found.lower[i]);
                upper[i] = here.posterior[i][0] * found.upper[i];
                out.occluded[i] = here.posterior[i][1];
                elsewhere += out.other[i] = here.posterior[i][2];
                astray += here.posterior[i][2] * odds_.astray(view_, i, sigma, shares()[0] / shares()[2]);
            }
            out.elsewhere = elsewhere / static_cast<double>(n);
            out.astray = astray / static_cast<double>(n);
            const std::vector<double> blur = learn_widths(out.G, upper, out);
            std::vector<bool> bounded(n);
            std::vector<double> seen = out.visible;
            for (std::size_t i = 0; i < n; ++i)
                // what is faint beside its own edge may be a mark of its surface, on which a tab goes on
                if (!(bounded[i] = is_bounded(view_.samples[i], target_.contrast[i]))) seen[i] = 0.0;
            out.other_shape = other_shape(
                target_, pyramid_, out.G, seen, bounded, blur, out.light,
                {numbers_.cell_unlikely, numbers_.cell_far, numbers_.cell_power, numbers_.cell_cover, allowed},
                shares(), stay(), power_, out.differs);
        }
        auto row = patches_.begin();
        for (std::size_t level = 0; level < std::min(told, target_.texture.size()); ++level) {
            out.correlation.emplace_back();
            for (std::size_t k = 0; k < target_.texture[level].patches.size(); ++k, ++row)
                out.correlation.back().push_back(row->match.inside ? row->match.correlation : std::numeric_limits<double>::quiet_NaN());
        }
    }

    const Target &target_;
    const Pyramid &pyramid_;
    const Start &start_;
    const Numbers &numbers_;
    double power_;
    Matrix<8> prior_{};
    std::vector<PatchRow> patches_;  // as they were matched last
    EdgeView view_;
    EdgeOdds odds_;
    EdgeLikelihoods likelihoods_;
    std::vector<States> explained_;
    Chain chain_;
    mutable std::vector<double> first_sides_;
};

}  // namespace grasptrack::pose
