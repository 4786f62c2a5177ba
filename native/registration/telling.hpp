// SPDX-License-Identifier: Apache-2.0
// What the solver tells of its answer: the widths of edges, a rolling shutter's readout, and the evidence for the object.
#pragma once

#include "occlusion.hpp"
#include "solver.hpp"

namespace grasptrack::pose {

// How wide the edges are that are seen, where next to nothing moves across them, and what motion adds where much does.
// Half of what blurs each edge, as far as it moved, or where that is not known as wide as most edges are.
inline std::vector<double> Solver::learn_widths(const Homography &G, const std::vector<double> &seen, Solution &out) const {
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

// What edges and texture tell of the readout, and how the pose depends on it. P, x: the unknowns' covariance, and values.
inline void Solver::tell_readout(const Matrix<unknowns> &P, const Vector<unknowns> &x, const TextureFit &texture, Solution &out) const {
    Vector<unknowns> across{};  // information that it shares with them
    double own = 0, toward = 0;
    for (std::size_t i = 0; i < pull_.size(); ++i) {
        own += weight_[i] * bent_[i] * bent_[i];
        toward += bent_[i] * pull_[i];
        for (std::size_t k = 0; k < 9; ++k) across[k] += weight_[i] * bent_[i] * rows_[i][k];
    }
    for (std::size_t i = 0; i < texture.weight.size(); ++i) {
        const double w = texture.weight[i];
        if (!(w > 0)) continue;
        const Patch &patch = *patches_[i].patch;
        const PatchMatch &m = patches_[i].match;
        const Point z = bent(start_.bend, patch.rows);
        const double zx = w * (m.wxx * z.x + m.wxy * z.y), zy = w * (m.wxy * z.x + m.wyy * z.y);
        own += zx * z.x + zy * z.y;
        toward += zx * m.dx + zy * m.dy;
        for (std::size_t k = 0; k < 8; ++k) {
            const double both = zx * patch.rows[0][k] + zy * patch.rows[1][k];
            across[k] += both;
            toward -= both * x[k];
        }
    }
    const Vector<unknowns> by = times<unknowns>(P, across);
    double information = own;
    for (std::size_t k = 0; k < 9; ++k) information -= across[k] * by[k];
    for (std::size_t k = 0; k < 8; ++k) out.by_readout[k] = -by[k];
    out.readout = start_.readout;
    if (!(information > least_told)) return;
    double scatter = 0;
    std::vector<Vector<1>> scores(pull_.size());
    for (std::size_t i = 0; i < scores.size(); ++i) {
        double alone = bent_[i];
        for (std::size_t k = 0; k < 9; ++k) alone -= rows_[i][k] * by[k];
        scores[i] = {alone * pull_[i]};
    }
    out.readout += toward / information;
    if (!scores.empty()) scatter = scatter_of<1>(scores)[0];
    out.readout_variance = (1 + scatter / information) / information;
}

// The evidence at the answer, edges looked for much farther away than the answer's own uncertainty.
inline void Solver::judge(Solution &out, bool edges, double h, double vh) {
    const std::size_t n = target_.points.size();
    out.visible.assign(n, 0.0);
    out.occluded.assign(n, 0.0);
    out.other.assign(n, 0.0);
    if (edges) {
        const int reach = whole(numbers_.wide * 2 * target_.radius, 0, farthest);
        view_ = measure_edges(target_, pyramid_, out.G, places_, reach, half_widths(out.G), out.light, 46, true);
        const std::vector<double> parallax = lower_face(out.G);
        weigh_edges(view_);
        const double likely = explain_edges(view_, std::vector<double>(n, 0.0), parallax, out.P, h, vh);
        const EdgeLikelihoods &found = likelihoods_;
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
        out.log_odds = likely - without.log_likelihood;
        const double allowed = std::max(numbers_.tolerance_px, numbers_.tolerance * 2 * target_.radius);
        const double sigma = allowed / 2;  // two standard deviations are as much as a contact may be off
        double elsewhere = 0, astray = 0, as_lower = 0, as_either = 0;
        for (std::size_t i = 0; i < n; ++i) {
            const double low = std::abs(parallax[i] * h);
            as_lower += low * here.posterior[i][0] * found.lower[i];
            as_either += low * here.posterior[i][0] * (found.upper[i] + found.lower[i]);
            out.visible[i] = here.posterior[i][0] * (found.upper[i] + found.lower[i]);
            upper[i] = here.posterior[i][0] * found.upper[i];
            out.occluded[i] = here.posterior[i][1];
            elsewhere += out.other[i] = here.posterior[i][2];
            if (view_.samples[i].inside) astray += here.posterior[i][2] * odds_.astray(view_, i, sigma);
        }
        out.elsewhere = elsewhere / static_cast<double>(n);
        if (as_either > 0) out.sides = as_lower / as_either;
        out.astray = astray * power_;
        const std::vector<double> blur = learn_widths(out.G, upper, out);
        std::vector<bool> bounded(n);
        std::vector<double> seen = out.visible;
        for (std::size_t i = 0; i < n; ++i)
            // what is faint beside its own edge may be a mark of its surface, on which a tab goes on
            if (!(bounded[i] = is_bounded(view_.samples[i], target_.contrast[i]))) seen[i] = 0.0;
        out.pieces = other_shape(
            target_, pyramid_, out.G, places_, seen, bounded, blur, out.light,
            {numbers_.cell_unlikely, numbers_.cell_far, numbers_.cell_power, numbers_.cell_cover, allowed},
            shares(), stay(), power_);
        out.other_shape = out.pieces.log_odds();
    }
    auto row = patches_.begin();
    for (std::size_t level = 0; level < std::min(fine_levels, target_.texture.size()); ++level) {
        out.correlation.emplace_back();
        for (std::size_t k = 0; k < target_.texture[level].patches.size(); ++k, ++row)
            out.correlation.back().push_back(row->match.inside ? row->match.correlation : std::numeric_limits<double>::quiet_NaN());
    }
}

}  // namespace grasptrack::pose
