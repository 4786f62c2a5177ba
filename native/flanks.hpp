// SPDX-License-Identifier: Apache-2.0
// What lies on the two sides of an outline: a cover, a notch or a tab. Defined in kernels/reference_flanks.py.
#pragma once

#include "differences.hpp"

namespace grasptrack {

constexpr double kOther = 4.0, kOtherGrey = 5.0, kClearly = 0.4, kMostOfIt = 0.5, kCompact = 0.05, kAstray = 0.15, kMostly = 0.4;
constexpr std::size_t kAcross = 3, kNotch = 2, kTab = 3;

struct FlankSamples {  // of m samples `depths` places within, then as many beyond
    const Vec *places;
    const double *values;
    const bool *against, *missed;
    std::size_t m, depths;
    double contrast;
    bool ground;
};

struct Side {
    bool changed, clearly, told;
};

inline Side side_of(const double *rest, std::size_t depths, double least, double clearly) {
    std::size_t told = 0, other = 0, clear = 0;
    for (std::size_t i = 0; i < depths; ++i) {
        const double size = std::fabs(rest[i]);
        told += std::isfinite(size) ? 1 : 0, other += size > least ? 1 : 0, clear += size > clearly ? 1 : 0;
    }
    const double wanted = std::max(kMostOfIt * static_cast<double>(told), 1.0);
    return {static_cast<double>(other) >= wanted, clear > 0, told > 0};
}

// Samples that follow one another round the outline, with gaps of at most one, for each run of them.
template <typename Each> void each_run(const std::vector<std::size_t> &index, std::size_t count, Each each) {
    if (index.empty()) return;
    std::vector<std::vector<std::size_t>> pieces(1);
    for (std::size_t k = 0; k < index.size(); ++k) {
        if (k > 0 && index[k] - index[k - 1] > 2) pieces.emplace_back();
        pieces.back().push_back(index[k]);
    }
    if (pieces.size() > 1 && index.front() + count - index.back() <= 2) {
        pieces.back().insert(pieces.back().end(), pieces.front().begin(), pieces.front().end());
        pieces.front() = std::move(pieces.back());
        pieces.pop_back();
    }
    for (const auto &run : pieces) each(run);
}

inline void judge_flanks(const Image<std::uint8_t> &coarse, double shrink, const double *H, const FlankSamples &in,
                         bool *out, bool *covered) {
    std::copy(in.against, in.against + in.m, out);
    std::fill(covered, covered + in.m, false);
    std::vector<double> rest(2 * in.depths * in.m);
    const double noise =
        grey_differences(coarse, shrink, H, in.places, in.values, rest.size(), kOtherGrey / kOther, rest.data());
    const double least = std::max(kOther * noise, kOtherGrey), clearly = kClearly * in.contrast;
    std::vector<Side> within(in.m), beyond(in.m);
    std::vector<std::size_t> odd;
    std::size_t shown[2] = {0, 0}, astray[2] = {0, 0};
    for (std::size_t i = 0; i < in.m; ++i) {
        const double *here = rest.data() + 2 * in.depths * i;
        within[i] = side_of(here, in.depths, least, clearly);
        beyond[i] = side_of(here + in.depths, in.depths, least, clearly);
        if (in.missed[i]) continue;
        const Side *sides[2] = {&within[i], &beyond[i]};
        for (int s = 0; s < 2; ++s)
            if (sides[s]->told) ++shown[s], astray[s] += sides[s]->changed ? 1 : 0;
    }
    for (int s = 0; s < 2; ++s)
        if (static_cast<double>(astray[s]) > kAstray * static_cast<double>(shown[s])) return;
    if (!in.ground) return;
    for (std::size_t i = 0; i < in.m; ++i) {
        if (within[i].told && beyond[i].told && !within[i].changed && !beyond[i].changed) out[i] = false;
        if (in.against[i] || in.missed[i] || within[i].changed || beyond[i].changed) odd.push_back(i);
    }
    const auto tab = [&](std::size_t i) {
        return beyond[i].changed && beyond[i].clearly && !within[i].changed && within[i].told && beyond[i].told;
    };
    const auto notch = [&](std::size_t i) {
        return within[i].changed && within[i].clearly && !beyond[i].changed && within[i].told && beyond[i].told &&
               in.missed[i];
    };
    each_run(odd, in.m, [&](const std::vector<std::size_t> &run) {
        std::size_t longest = 0, row = 0, both = 0, tabs = 0, notches = 0;
        for (const std::size_t i : run) {
            row = within[i].changed && beyond[i].changed ? row + 1 : 0;
            longest = std::max(longest, row);
            both += row > 0 ? 1 : 0;
            tabs += tab(i) ? 1 : 0, notches += notch(i) ? 1 : 0;
        }
        const bool grown = tabs >= kTab && static_cast<double>(tabs) <= kCompact * static_cast<double>(in.m);
        const bool across = longest >= kAcross && static_cast<double>(both) >= kMostly * static_cast<double>(run.size());
        for (const std::size_t i : run) {
            if (across) {
                out[i] = false;
                covered[i] = in.missed[i];
            } else {
                out[i] = out[i] || (grown && tab(i)) || (notches >= kNotch && notch(i));
            }
        }
    });
}

}  // namespace grasptrack
