// SPDX-License-Identifier: Apache-2.0
// Repeated blocks: what a video's encoder left as it was is no new look at the object.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "matrix.hpp"
#include "pyramid.hpp"
#include "target.hpp"
#include "texture.hpp"

namespace grasptrack::pose {

struct Repeats {
    double change = 0;  // grey levels^2, by which the motion would have changed patches, each on average: what they tell of it
    double way = 0;     // the same of those that are as they were, times the squares of how far they ought to have moved, work px^2
};

// Which patches of the finest levels an image shows where the last one has them, to the grey level or nearly, though the pose moved on.
GRASPTRACK_WIDE inline Repeats count_repeats(const Target &target, const Pyramid &before, const Homography &last, const Pyramid &now, const Homography &G) {
    constexpr double rounding = 2.0 / 12;  // variance of the difference of two whole numbers: two exposures differ by more
    constexpr double plain = 6;            // times as much is no rounding
    Repeats out;
    Lattice here, there;
    double value[patch_pixels], same[patch_pixels], moved[patch_pixels];
    const auto mean_square = [](const double *a, const double *b) {
        double sum = 0;
        for (int k = 0; k < patch_pixels; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
        return sum / patch_pixels;
    };
    for (std::size_t k = 0; k < std::min(fine_levels, target.texture.size()); ++k) {
        const double stride = target.texture[k].stride;
        for (const Patch &patch : target.texture[k].patches) {
            if (!here.lay(now, G, {patch.x, patch.y}, stride) || !there.lay(before, last, {patch.x, patch.y}, stride)) continue;
            before[static_cast<std::size_t>(here.level - now.data())].at(here.x, here.y, patch_pixels, same);
            there.level->at(there.x, there.y, patch_pixels, moved);
            const double change = mean_square(moved, same);
            if (!(change > plain * rounding)) continue;  // it would look alike
            here.level->at(here.x, here.y, patch_pixels, value);
            out.change += change;
            if (!(mean_square(value, same) < rounding)) continue;
            const Point to = carried(G, patch.x, patch.y), from = carried(last, patch.x, patch.y);
            const auto d = derivatives(G, patch.x, patch.y);
            const double squared = (to.x - from.x) * (to.x - from.x) + (to.y - from.y) * (to.y - from.y);
            out.way += change * squared / std::abs(d[0] * d[3] - d[1] * d[2]);
        }
    }
    return out;
}

}  // namespace grasptrack::pose
