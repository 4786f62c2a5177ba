// SPDX-License-Identifier: Apache-2.0
// One hypothesis of the pose, made exact: Gauss-Newton on edges, texture, thickness and what a pinhole allows, with a
// prior of heavy tails; and the evidence for it.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "camera.hpp"
#include "edges.hpp"
#include "matrix.hpp"
#include "occlusion.hpp"
#include "system.hpp"
#include "texture.hpp"

namespace grasptrack::pose {

struct Solution {
    bool valid = false;
    Homography G{};
    Matrix<8> P{};
    Matrix<8> beforehand{};  // information that is in it and not the image's: what was expected, and what a camera can show
    double readout = 0, readout_variance = std::numeric_limits<double>::infinity();  // as the edges tell it, and of that
    Vector<8> by_readout{};  // of the pose's error
    Nuisance nuisance{};
    Matrix<nuisances> nuisance_covariance{};
    double sides = std::numeric_limits<double>::quiet_NaN();  // see EdgeNumbers; NaN where upper and lower face look alike
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
    double astray = 0;       // log-likelihood ratio of the edges elsewhere: of something else, against light and a pose a little off
    double other_shape = 0;  // log-likelihood ratio of another shape
    OtherShape pieces;       // it by these
};

class Solver {
  public:
    Solver(const Target &target, const Pyramid &pyramid, const Start &start, const Numbers &numbers)
        : target_(target), pyramid_(pyramid), start_(start), numbers_(numbers) {
        const std::size_t n = target.points.size();
        power_ = 0;
        if (n > 0) power_ = std::min(1.0, spacing() / numbers.sample_distance);
        for (std::size_t i = 0; i < n; ++i) {
            const Point p = target.points[i], m = target.normals[i], beside = bent(start.bend, target.jacobian(p.x, p.y));
            places_.push_back(seen_at(p, target.jacobian(p.x, p.y)));
            bent_.push_back(beside.x * m.x + beside.y * m.y);
        }
    }

    Solution solve() {
        Solution out;
        if (!invert<8>(start_.P, beliefs_.pose) || !invert<nuisances>(start_.nuisance_covariance, beliefs_.nuisance)) return out;
        Homography G = start_.G;
        if (!texture_alone(G)) return out;
        Matrix<8> P = start_.P;
        const bool edges = target_.points.size() >= 8;
        Nuisance nuisance = start_.nuisance;
        Matrix<nuisances> spread = start_.nuisance_covariance;
        const int first = whole(start_.reach, 0, farthest);
        int reach = first;
        constexpr int rounds = 8, direct = 4;
        Vector<8> last{};
        Matrix<unknowns> all{};
        Vector<unknowns> x{};
        TextureFit texture;
        bool done = false;
        for (int round = 0; round < rounds && !done; ++round) {
            System system;
            Matrix<8> A;
            Vector<8> b;
            if (!system_about(target_, start_, numbers_, beliefs_, G, nuisance, system)) return out;
            reduce<8>(system.A, system.b, A, b);
            out.beforehand = A;
            texture = texture_rows(G, A, b, out);
            add_rows<8>(system.A, system.b, texture.information, texture.gradient);
            add_rows<8>(A, b, texture.information, texture.gradient);
            if (!invert<8>(A, P)) return out;
            out.light = surface_light(target_, pyramid_, G, start_.light);
            Matrix<9> scatter{};
            if (edges) {
                if (reach == 0 || round == 0) {
                    const int own = reach_of(P, 2.5, 3.0);
                    reach = round == 0 && start_.reach > 0 ? first : own;
                }
                const std::vector<int> half = half_widths(G);
                view_ = measure_edges(target_, pyramid_, G, places_, reach, half, out.light, 46);
                if (is_other_light(target_, out.light, start_.light)) {  // or most is covered: by the outline's inner side
                    EdgeView before = measure_edges(target_, pyramid_, G, places_, reach, half, start_.light, 46);
                    const auto likely = [&](const EdgeView &view) {
                        weigh_edges(view);
                        return explain_edges(view, std::vector<double>(half.size(), 0.0), lower_face(G), P, nuisance[0], spread[0]);
                    };
                    if (likely(before) > likely(view_)) {
                        view_ = std::move(before);
                        out.light = start_.light;
                    }
                }
                if (!fit_edges(round == 0 ? 3 : 4, G, times<8>(P, b), P, nuisance[0], spread[0], system, scatter, out)) return out;
            }
            if (!invert<unknowns>(system.A, all)) return out;
            x = times<unknowns>(all, system.b);
            Matrix<unknowns> wide = all;
            add_correlated(wide, scatter);
            P = block<unknowns, 8>(wide, 0);
            spread = block<unknowns, nuisances>(wide, 8);
            Vector<8> d;
            // what does not settle goes to and fro between two answers
            for (std::size_t k = 0; k < 8; ++k) d[k] = std::clamp(round < direct ? x[k] : 0.5 * x[k], -target_.radius, target_.radius);
            for (std::size_t k = 0; k < nuisances; ++k) nuisance[k] = bounded_nuisance(k, x[8 + k]);
            if (!learned_nuisances(system, scatter, target_.radius, out.nuisance, out.nuisance_covariance)) return out;
            const double moved = contacts_moved(d);
            G = target_.moved(G, d);
            if (!finite(G)) return out;
            if (edges) reach = whole(reach_of(P, 3.0, 3.0) + moved, 4, 30);
            last = d;
            done = moved < settled && round > 0;
            // after the first few, what moves by less than half its own standard deviation is not worth another
            if (round + 1 >= direct && moved < 0.5 * contacts_deviation(P)) break;
        }
        tell_readout(all, x, texture, out);
        if (!done) patches_ = match_all(0, fine_levels, G);  // else the last step moved none of them
        // an answer that still moves is not known better than by its last step
        for (std::size_t a = 0; a < 8; ++a)
            for (std::size_t c = 0; c < 8; ++c) P[a * 8 + c] += last[a] * last[c];
        out.G = G;
        out.P = P;
        out.valid = true;
        judge(out, edges, nuisance[0], spread[0]);
        return out;
    }

  private:
    static constexpr double settled = 0.02;  // work px: a step that moves no contact by more is the last
    static constexpr double least_told = 1e-9;  // information about a readout that is none
    static constexpr double exact = 0.002;   // the same where edges are weighed anew

    // Work px, where a place, which tells its shift by rows J, is seen through the pose, by the readout that is believed.
    Point seen_at(Point p, const std::array<Vector<8>, 2> &J) const {
        if (start_.readout == 0.0) return p;
        const Point beside = bent(start_.bend, J);
        return {p.x + start_.readout * beside.x, p.y + start_.readout * beside.y};
    }

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

    TextureNumbers texture_numbers() const {
        return {numbers_.texture_floor, numbers_.texture_independent, numbers_.texture_freedom};
    }

    // Whether the texture tells anything of the pose.
    bool is_witness() const {
        return std::all_of(start_.lag.begin(), start_.lag.end(), [](double v) { return std::isfinite(v); });
    }

    // All patches of the levels from `first` to `end`.
    std::vector<PatchRow> match_all(std::size_t first, std::size_t end, const Homography &G) const {
        std::vector<PatchRow> rows;
        std::vector<std::size_t> still;
        std::size_t asked = 0;
        const double way = moved_from_first(G, {target_.cx, target_.cy});
        for (std::size_t level = first; level < std::min(end, target_.texture.size()); ++level) {
            const PatchSet &set = target_.texture[level];
            for (const Patch &patch : set.patches) {
                rows.push_back({&patch, match_patch(pyramid_, G, patch, seen_at({patch.x, patch.y}, patch.rows), set.stride, target_.noise, numbers_.texture_floor * set.stride)});
                if (!rows.back().match.inside || !may_stand_still(G, way, patch, rows.back().match.correlation)) continue;
                ++asked;
                const PatchMatch there = match_patch(pyramid_, target_.A, patch, {patch.x, patch.y}, set.stride, target_.noise, 0.0);
                if (there.correlation > agreeing) still.push_back(rows.size() - 1);
            }
        }
        // what the image shows where the first view had it is none of the object that has moved on: dirt on the lens, a bezel
        if (is_no_chance(static_cast<double>(still.size()), asked))
            for (std::size_t k : still) rows[k].match.inside = false;
        return rows;
    }

    // px that a place has moved since the first view.
    double moved_from_first(const Homography &G, Point p) const {
        const Point here = carried(G, p.x, p.y), first = carried(target_.A, p.x, p.y);
        return std::hypot(here.x - first.x, here.y - first.y);
    }

    // Whether a patch does not lie where the pose has it, or lies there because the object turned about it, though that has moved a way.
    bool may_stand_still(const Homography &G, double way, const Patch &patch, double correlation) const {
        constexpr double least = 1.0, share = 0.25;  // px that the object's middle has moved, and of that what stands still
        return way > least && !(correlation > agreeing && moved_from_first(G, {patch.x, patch.y}) > share * way);
    }

    // Coarse to fine on the texture, before edges are looked at: their candidates are many, its valley is wide.
    bool texture_alone(Homography &G) const {
        if (!is_witness()) return true;
        double far = 0;  // work px within which the pose is known
        for (const Point &p : target_.contacts) {
            const auto J = target_.jacobian(p.x, p.y);
            for (const auto &row : J) far = std::max(far, std::sqrt(quadratic<8>(start_.P, row.data())));
        }
        for (std::size_t level = target_.texture.size(); level-- > 0;) {
            const PatchSet &set = target_.texture[level];
            if (set.patches.size() < 4 || (level > 0 && far < set.stride)) continue;
            for (int round = 0; round < 3; ++round) {
                System system;
                Matrix<8> A, P;
                Vector<8> b;
                if (!system_about(target_, start_, numbers_, beliefs_, G, start_.nuisance, system)) break;
                reduce<8>(system.A, system.b, A, b);
                const TextureFit fit_and = fit_patches(match_all(level, level + 1, G), A, b, texture_numbers());
                if (!tells(fit_and, set.patches.size())) break;
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

    TextureFit texture_rows(const Homography &G, const Matrix<8> &A, const Vector<8> &b, Solution &out) {
        TextureFit none;
        patches_ = match_all(0, fine_levels, G);
        if (patches_.size() < 4) return none;
        TextureFit fit = fit_patches(patches_, A, b, texture_numbers());
        out.texture_used = fit.used;
        out.texture_agreeing = fit.agreeing;
        out.texture_spread = fit.spread;
        if (!is_witness() || !tells(fit, patches_.size())) return none;
        share_error(fit, start_.lag);
        return fit;
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

    States shares() const { return {numbers_.share_object, numbers_.share_occluded, numbers_.share_other}; }
    double stay() const { return std::exp(-1.0 / (numbers_.stretch * static_cast<double>(target_.points.size()))); }
    EdgeNumbers edge_numbers() const {
        return {numbers_.edge_missed, numbers_.same_sign, numbers_.edge_floor, start_.inner_spread, numbers_.other_spread, start_.sides};
    }

    // What the edges of a view say wherever the outline is expected; that it lies elsewhere is as likely everywhere.
    void weigh_edges(const EdgeView &view) {
        edge_odds(target_, view, edge_numbers(), odds_);
        explained_.resize(odds_.other.size());
        for (std::size_t i = 0; i < explained_.size(); ++i) explained_[i] = {1.0, 1.0, std::pow(odds_.other[i], power_)};
    }

    // Whose edges those of a view are that was weighed, where `shift` expects them. P: of the pose's error; h, vh: of the thickness.
    // Log-likelihood ratio against clutter.
    double explain_edges(const EdgeView &view, const std::vector<double> &shift, const std::vector<double> &parallax, const Matrix<8> &P,
                         double h, double vh) {
        const std::size_t n = shift.size();
        std::vector<double> low(n), variance(n);
        for (std::size_t i = 0; i < n; ++i) {
            low[i] = parallax[i] * h;
            variance[i] = parallax[i] * parallax[i] * vh;
        }
        edge_likelihoods(target_, view, odds_, shift, low, variance, P, edge_numbers(), likelihoods_);
        for (std::size_t i = 0; i < n; ++i) explained_[i][0] = std::pow(likelihoods_.object[i], power_);
        explain(explained_, shares(), stay(), true, 1.0, chain_);
        return chain_.log_likelihood;
    }

    // Edges and thickness, by expectation and maximisation: which candidate, then the pose, `rounds` times at most. Their rows are added to
    // the system; `scatter` is of their scores, which are correlated with their neighbours'. d, P: the pose's error without them; h, vh: of the
    // thickness.
    GRASPTRACK_WIDE bool fit_edges(int rounds, const Homography &G, Vector<8> d, Matrix<8> P, double h, double vh, System &system, Matrix<9> &scatter,
                                   Solution &out) {
        const std::size_t n = target_.points.size();
        const std::vector<double> parallax = lower_face(G);
        weight_.resize(n);
        Matrix<9> A, own{};
        Vector<9> b, toward{};
        Packed<8> along{};
        reduce<9>(system.A, system.b, A, b);
        std::vector<double> shift(n), seen_up(n), seen_low(n), sorted;
        weigh_edges(view_);
        Vector<8> last = d;
        for (int round = 0; round < rounds; ++round) {
            Vector<8> change;
            for (std::size_t k = 0; k < 8; ++k) change[k] = d[k] - last[k];
            if (round > 1 && contacts_moved(change) < exact) break;
            last = d;
            for (std::size_t i = 0; i < n; ++i) {
                shift[i] = 0;
                for (std::size_t k = 0; k < 8; ++k) shift[i] += target_.rows[i][k] * d[k];
            }
            explain_edges(view_, shift, parallax, P, h, vh);
            sorted.clear();
            for (std::size_t i = 0; i < n; ++i) {
                const double own = chain_.posterior[i][0];
                seen_up[i] = likelihoods_.upper[i] * own;
                seen_low[i] = likelihoods_.lower[i] * own;
                const double up = likelihoods_.upper_offset[i] - shift[i];
                const double down = likelihoods_.lower_offset[i] - shift[i] - parallax[i] * h;
                if (seen_up[i] + seen_low[i] > 0.5) sorted.push_back(std::abs(seen_up[i] > seen_low[i] ? up : down));
            }
            double variance = 4.0;
            if (sorted.size() > 10) {
                const double mad = 1.4826 * middle(sorted);
                variance = numbers_.edge_noise * numbers_.edge_noise + mad * mad;
            }
            Packed<8> sum{};
            along = {};
            Vector<9> across{};  // with the thickness, the ninth unknown
            toward = {};
            for (std::size_t i = 0; i < n; ++i) {
                const double up = likelihoods_.upper_offset[i] - shift[i];
                const double down = likelihoods_.lower_offset[i] - shift[i] - parallax[i] * h;
                const double wu = seen_up[i] / variance * power_ / (1 + up * up / (9 * variance));
                const double wl = seen_low[i] / variance * power_ / (1 + down * down / (9 * variance));
                weight_[i] = wu + wl;
                const double u = wu > 1e-9 ? wu : 0.0, l = wl > 1e-9 ? wl : 0.0;
                if (!(u + l > 0)) continue;
                const Vector<8> &J = target_.rows[i];
                const Packed<8> &square = target_.squares[i], &aside = target_.along[i];
                for (std::size_t k = 0; k < square.size(); ++k) {
                    sum[k] += (u + l) * square[k];
                    along[k] += (u + l) * aside[k];
                }
                const double drawn = u * likelihoods_.upper_offset[i] + l * likelihoods_.lower_offset[i], shared = l * parallax[i];
                for (std::size_t a = 0; a < 8; ++a) {
                    toward[a] += drawn * J[a];
                    across[a] += shared * J[a];
                }
                across[8] += shared * parallax[i];
                toward[8] += shared * likelihoods_.lower_offset[i];
            }
            const Matrix<8> lead = unpacked<8>(sum);
            for (std::size_t a = 0; a < 8; ++a)
                for (std::size_t c = 0; c < 8; ++c) own[a * 9 + c] = lead[a * 8 + c];
            for (std::size_t a = 0; a < 9; ++a) own[a * 9 + 8] = own[72 + a] = across[a];
            Matrix<9> both = A, P9;
            Vector<9> right = b;
            add_rows<9>(both, right, own, toward);
            if (!invert<9>(both, P9)) return false;
            const Vector<9> x = times<9>(P9, right);
            for (std::size_t a = 0; a < 8; ++a) d[a] = x[a];
            P = block<9, 8>(P9, 0);
            h = std::max(0.0, x[8]);
            vh = P9[80];
            out.edge_sigma = std::sqrt(variance);
        }
        const Matrix<9> telling = beyond_noise(own, along);
        add_rows<9>(system.A, system.b, times<9>(times<9>(telling, own), transposed<9>(telling)), times<9>(telling, toward));
        std::vector<Vector<9>> scores(n);
        pull_.resize(n);
        rows_.resize(n);
        double share = 0;
        sorted.clear();
        for (std::size_t i = 0; i < n; ++i) {
            const bool lower = seen_low[i] >= seen_up[i];
            double residual = lower ? likelihoods_.lower_offset[i] - parallax[i] * h : likelihoods_.upper_offset[i];
            for (std::size_t k = 0; k < 8; ++k) residual -= target_.rows[i][k] * d[k];
            for (std::size_t k = 0; k < 8; ++k) rows_[i][k] = target_.rows[i][k];
            rows_[i][8] = lower ? parallax[i] : 0.0;
            rows_[i] = times<9>(telling, rows_[i]);
            pull_[i] = weight_[i] * residual;
            for (std::size_t k = 0; k < 9; ++k) scores[i][k] = pull_[i] * rows_[i][k];
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
        scatter = scatter_of<9>(scores);
        return true;
    }

    std::vector<double> lower_face(const Homography &G) const {
        const Pinhole camera(target_, {start_.nuisance[1], start_.nuisance[2], start_.nuisance[3]}, start_.frame);
        std::vector<double> now = camera.lower_face(target_, G);
        const std::vector<double> &first = first_sides(camera);
        for (std::size_t i = 0; i < now.size(); ++i) now[i] -= first[i];  // sides that the first view showed count the other way
        return now;
    }

    const std::vector<double> &first_sides(const Pinhole &camera) const {
        if (first_sides_.empty()) first_sides_ = camera.first_lower_face(target_);
        return first_sides_;
    }

    // In telling.hpp: what is told of an answer.
    std::vector<double> learn_widths(const Homography &G, const std::vector<double> &seen, Solution &out) const;
    void tell_readout(const Matrix<unknowns> &P, const Vector<unknowns> &x, const TextureFit &texture, Solution &out) const;
    void judge(Solution &out, bool edges, double h, double vh);

    const Target &target_;
    const Pyramid &pyramid_;
    const Start &start_;
    const Numbers &numbers_;
    double power_;
    Beliefs beliefs_;
    std::vector<Point> places_;  // of the samples, beside their own by the readout that is believed
    std::vector<double> bent_;   // work px along the normals, for a readout of 1
    std::vector<double> weight_, pull_;  // of each edge in the last round, and that times what is left of its offset
    std::vector<Vector<9>> rows_;        // its derivatives by pose and thickness
    std::vector<PatchRow> patches_;  // as they were matched last
    EdgeView view_;
    EdgeOdds odds_;
    EdgeLikelihoods likelihoods_;
    std::vector<States> explained_;
    Chain chain_;
    mutable std::vector<double> first_sides_;
};

}  // namespace grasptrack::pose
