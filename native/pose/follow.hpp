// SPDX-License-Identifier: Apache-2.0
// The last look laid on the next image. The NumPy definition is grasptrack.kernels.reference_pose_texture.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "target.hpp"
#include "texture.hpp"

namespace grasptrack::pose {

// Each coarser level has half the places, the first ones, but no fewer than these: its patches are twice as wide.
constexpr std::size_t fewest_places = 24;

// Patches of one look laid on another image, coarse to fine, from a given start. For predictions.
struct FlowFit {
    bool valid = false;
    Homography G{};
    Matrix<8> covariance{};
    double agreeing = 0, correlation = 0;
    int used = 0;
};

inline FlowFit follow_look(const Target &target, const std::vector<PatchSet> &looks, const Pyramid &pyramid, const Homography &start,
                           const Matrix<8> &prior_covariance, double noise, const TextureNumbers &numbers) {
    FlowFit out;
    Matrix<8> prior;
    if (!invert<8>(prior_covariance, prior)) return out;
    Homography G = start;
    for (std::size_t level = looks.size(); level-- > 0;) {
        const PatchSet &set = looks[level];
        if (set.patches.size() < 6) continue;
        for (int round = 0; round < (level + 1 == looks.size() ? 5 : 3); ++round) {
            Vector<8> d;
            if (!target.difference(start, G, d)) return out;
            Matrix<8> A = prior;
            Vector<8> b = times<8>(A, d);
            for (double &value : b) value = -value;
            std::vector<PatchRow> matches;
            double sum = 0;
            for (const Patch &patch : set.patches) {
                matches.push_back({&patch, match_patch(pyramid, G, patch, {patch.x, patch.y}, set.stride, noise, numbers.floor * set.stride)});
                sum += matches.back().match.correlation;
            }
            const TextureFit fit = fit_patches(matches, A, b, numbers);
            if (fit.used < 6) return out;
            for (std::size_t k = 0; k < 64; ++k) A[k] += fit.information[k];
            for (std::size_t k = 0; k < 8; ++k) b[k] += fit.gradient[k];
            Matrix<8> P;
            if (!invert<8>(A, P)) return out;
            const Vector<8> step = times<8>(P, b);
            G = target.moved(G, step);
            for (double value : G)
                if (!std::isfinite(value)) return out;
            out.covariance = P;
            out.used = fit.used;
            out.agreeing = fit.agreeing;
            out.correlation = sum / static_cast<double>(matches.size());
            double most = 0;
            for (double value : step) most = std::max(most, std::abs(value));
            if (most < 0.05 * set.stride) break;
        }
    }
    out.valid = out.used > 0;
    out.G = G;
    return out;
}

}  // namespace grasptrack::pose
