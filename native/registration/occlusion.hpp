// SPDX-License-Identifier: Apache-2.0
// Explanations of the outline come in stretches: a Markov chain along it, of three states.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "edges.hpp"

namespace grasptrack::pose {

using States = std::array<double, 3>;  // the object's edge, an occluder, another shape

struct Chain {
    double log_likelihood = 0;
    std::vector<States> posterior;
};

// Forward-backward, of likelihoods by state. `mixed`: factor of the probability that an occluder and another shape lie side by
// side, without the object's edge between them.
inline void explain(const std::vector<States> &likelihood, const States &share, double stay, bool backward, double mixed, Chain &out) {
    const std::size_t n = likelihood.size();
    out.posterior.resize(n);
    out.log_likelihood = 0;
    const double apart = 1 - mixed;
    const States drawn{(1 - stay) * share[0], (1 - stay) * share[1], (1 - stay) * share[2]};
    States before = share;
    double product = 1;  // of the sums: their logarithm now and then
    for (std::size_t i = 0; i < n; ++i) {
        const States &L = likelihood[i];
        States a;
        if (i == 0) {
            a = {share[0] * L[0], share[1] * L[1], share[2] * L[2]};
        } else {
            a = {(stay * before[0] + drawn[0]) * L[0], (stay * before[1] + drawn[1] * (1 - apart * before[2])) * L[1],
                 (stay * before[2] + drawn[2] * (1 - apart * before[1])) * L[2]};
        }
        const double sum = a[0] + a[1] + a[2], s = 1 / sum;
        out.posterior[i] = before = {a[0] * s, a[1] * s, a[2] * s};
        product *= sum;
        if (!(product > 1e-100 && product < 1e100)) {
            out.log_likelihood += std::log(product);
            product = 1;
        }
    }
    out.log_likelihood += std::log(product);
    if (!backward) return;
    States b{1, 1, 1};
    for (std::size_t i = n; i-- > 0;) {
        if (i + 1 < n) {
            const States &L = likelihood[i + 1];
            const States seen{L[0] * b[0], L[1] * b[1], L[2] * b[2]};
            const States to{drawn[0] * seen[0], drawn[1] * seen[1], drawn[2] * seen[2]};
            const double m = to[0] + to[1] + to[2];
            b = {stay * seen[0] + m, stay * seen[1] + m - apart * to[2], stay * seen[2] + m - apart * to[1]};
            const double s = 3 / (b[0] + b[1] + b[2]);
            for (double &value : b) value *= s;
        }
        States &p = out.posterior[i];
        p = {p[0] * b[0], p[1] * b[1], p[2] * b[2]};
        const double s = 1 / (p[0] + p[1] + p[2]);
        for (double &value : p) value *= s;
    }
}

// Likelihood ratios as so much of an independent measurement each.
inline void temper(std::vector<double> &ratios, double power) {
    for (double &value : ratios)
        if (value != 1.0) value = std::pow(value, power);
}

// The same, of likelihood ratios against an occluder.
inline Chain stretches(const std::vector<double> &object, const std::vector<double> &other, const States &share, double stay, bool backward,
                       double mixed) {
    std::vector<States> likelihood(object.size());
    for (std::size_t i = 0; i < object.size(); ++i) likelihood[i] = {object[i], 1.0, other[i]};
    Chain out;
    explain(likelihood, share, stay, backward, mixed, out);
    return out;
}

// What lies beside the outline where its edge is not seen: the object's own inside and the background outside, something
// in front, or another shape - background where the object should be (a notch), the object where it should end (a tab).

struct RegionNumbers {
    double unlikely;   // share of cells that nothing explains
    double far;        // share of the size within which the outline must be seen, for a notch or tab on both sides
    double power;      // of a sample's agreement: a shape is as sure as the least sure of what it asks for
    double cover;      // grey levels, by which what covers a side differs from it
    double shallow;    // work px: what differs less deeply is the same shape
};

constexpr int first_cells = 4;  // beside the outline: what tells the levels here, and whether a side is as it was
constexpr int near_samples = 8;  // seen ones, on each side of a stretch that is not, that count for the levels there
constexpr double least_spread = 3.0;  // grey levels, of any spread

struct Levels {  // grey levels on one side of the visible outline near a sample
    double level = 0, spread = 0;
    bool known = false, between = false;  // of what is seen on one side of the stretch at least, on both
};

// The nearest visible samples of the outline, beyond the stretch that is not seen. All samples of a stretch share them.
struct Beside {
    std::vector<std::size_t> samples;
    int sides = 0;  // on which there are enough

    bool operator==(const Beside &other) const { return sides == other.sides && samples == other.samples; }
};

// A side on which the stretch goes on for `far` samples tells nothing: what lies far from all that fits is not known.
inline Beside beside(std::size_t i, const std::vector<double> &visible, int far) {
    constexpr int few = 4, asked = 12;  // samples that must be there, and that are asked on each side
    const auto n = static_cast<int>(visible.size());
    Beside out;
    for (int side = -1; side <= 1; side += 2) {
        const auto at = [&](int step) {  // less than once round
            const int j = static_cast<int>(i) + side * step;
            return static_cast<std::size_t>(j < 0 ? j + n : j < n ? j : j - n);
        };
        int first = 1;
        while (first < n && first <= far && visible[at(first)] <= 0.5) ++first;
        if (first > far) continue;
        int found = 0;
        for (int step = first; step < std::min(first + asked, n) && found < near_samples; ++step) {
            if (visible[at(step)] < 0.7) continue;
            ++found;
            out.samples.push_back(at(step));
        }
        out.sides += found >= few;
    }
    return out;
}

// Median and spread of the first cells of samples; NaN where a cell does not count.
inline Levels levels_of(const Beside &near, const std::vector<double> &cells) {
    std::vector<double> levels;
    for (std::size_t j : near.samples)
        for (std::size_t k = 0; k < first_cells; ++k)
            if (const double v = cells[j * region_cells + k]; v == v) levels.push_back(v);
    Levels out;
    out.between = near.sides == 2;
    if (near.sides == 0 || levels.size() < 3 * first_cells) return out;
    out.level = middle(levels);
    for (double &v : levels) v = std::abs(v - out.level);
    out.spread = 1.4826 * middle(levels) + least_spread;
    out.known = true;
    return out;
}

// Nats by which a grey level is a level as it varies, rather than one of what covers it.
inline double log_cell(double value, double level, double spread, const RegionNumbers &numbers) {
    const double z = value - level, own = spread * spread, cover = own + numbers.cover * numbers.cover;
    return std::log((1 - numbers.unlikely) * std::sqrt(cover / own) * std::exp(0.5 * z * z * (1 / cover - 1 / own)) + numbers.unlikely);
}

using Cells = std::array<double, region_cells>;  // nats; NaN where a cell does not count

// Their mean from `begin` to `end`, or `none`.
inline double mean_cells(const Cells &cells, std::size_t begin, std::size_t end, double none) {
    double sum = 0;
    int count = 0;
    for (std::size_t k = begin; k < end; ++k)
        if (cells[k] == cells[k]) {
            sum += cells[k];
            ++count;
        }
    return count > 0 ? sum / count : none;
}

// How well a notch or tab of the best depth explains one side: something else from the outline on, up to a boundary of its own,
// and beyond that what should be there. What lies in front of the object goes on.
inline double closed(const Cells &strange, const Cells &usual, std::size_t shallow, double least) {
    constexpr std::size_t edge = 1, behind = 2;  // cells: of the boundary, beyond it
    double best = -std::numeric_limits<double>::infinity();
    for (std::size_t d = shallow; d + behind < region_cells; ++d)
        best = std::max(best, std::min(mean_cells(strange, 0, d, least),
                                       mean_cells(usual, d + edge, std::min<std::size_t>(d + edge + behind, region_cells), 0.0)));
    return best;
}

// Whether a sample shows a boundary where its edge is expected, of whatever sign: what lies there ends there.
inline bool is_bounded(const EdgeSample &sample, double contrast) {
    constexpr double near = 2.0, faint = 0.25;  // work px; share of the first view's contrast
    for (int c = 0; c < sample.count; ++c)
        if (std::abs(sample.offset[static_cast<std::size_t>(c)]) < near &&
            std::abs(sample.step[static_cast<std::size_t>(c)]) > faint * std::abs(contrast))
            return true;
    return !sample.inside;
}

// How many cells of each sample are looked at: all where something has to explain them, the first ones where they tell what is
// usual here. Empty where nothing has to be explained.
inline std::vector<std::size_t> cells_asked(const std::vector<double> &visible, const std::vector<bool> &bounded) {
    std::vector<std::size_t> asked(visible.size(), 0);
    bool any = false;
    for (std::size_t i = 0; i < visible.size(); ++i) {
        const bool open = !(visible[i] > 0.5) && !bounded[i];
        any = any || open;
        if (open) asked[i] = region_cells;
        else if (!(visible[i] < 0.7)) asked[i] = first_cells;
    }
    if (!any) asked.clear();
    return asked;
}

// Log-likelihood ratio of "some stretch shows another shape" against "this shape, partly occluded", -1 where nothing tells, and
// the probability of each sample that it is of that stretch.
struct OtherPiece {
    double log_odds = 0;
    std::vector<double> samples;
};

// Another shape by a piece whose own end is seen, and by one that goes on.
struct OtherShape {
    OtherPiece closed, open;
    double log_odds() const { return open.log_odds > 0 ? std::max(closed.log_odds, open.log_odds) : closed.log_odds; }
};

// `blur`: half of what moves across each sample while it is exposed, work px: so far both sides are mixed.
inline OtherShape other_shape(const Target &target, const Pyramid &pyramid, const Homography &G, const std::vector<Point> &places, const std::vector<double> &visible,
                          const std::vector<bool> &bounded, const std::vector<double> &blur, Light light, const RegionNumbers &numbers,
                          const States &share, double stay, double power) {
    const std::size_t n = target.points.size();
    OtherShape found{{0.0, std::vector<double>(n)}, {0.0, std::vector<double>(n)}};
    if (n == 0 || target.depth.size() != region_cells) return found;
    found.closed.log_odds = -1.0;
    const std::vector<std::size_t> asked = cells_asked(visible, bounded);
    if (asked.empty()) return found;
    std::vector<double> inner(n * region_cells), outer(n * region_cells);
    const Seen seen = look_through(pyramid, G, {target.cx, target.cy});
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < asked[i]; ++k)
            for (int side = 0; side < 2; ++side) {
                const double d = side == 0 ? -target.depth[k] : target.depth[k];
                const Point q = carried(seen.H, places[i].x + d * target.normals[i].x, places[i].y + d * target.normals[i].y);
                (side == 0 ? inner : outer)[i * region_cells + k] =
                    !(target.depth[k] < blur[i]) && seen.level->holds(q.x, q.y, 1.0) ? seen.level->at(q.x, q.y)
                                                                                     : std::numeric_limits<double>::quiet_NaN();
            }
    // the inside less what it was, the outside where it is outside: light and background as they are here and now
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> material(n * region_cells), changed(n * region_cells), beyond(n * region_cells);
    for (std::size_t q = 0; q < changed.size(); ++q) {
        material[q] = target.inside[q] == target.inside[q] ? inner[q] : nothing;
        changed[q] = inner[q] - (light.gain * target.inside[q] + light.bias);
        beyond[q] = target.outside[q] > 0 ? outer[q] : nothing;
    }
    constexpr double seen_odds = 20.0;  // of the object's edge, where it is seen
    constexpr double bounded_odds = 0.3;  // of another shape, where some boundary lies at the outline
    constexpr double amiss = 0.05;        // share of a notch's or tab's stretch that does not look like one: its own corners
    constexpr double meeting = 1e-3;      // factor: an occluder begins just where a notch or tab ends
    constexpr double imitated = 0.05;     // probability that what covers the object looks like its ground, or like itself
    std::vector<double> same(n, 1.0), differs(n, 1.0), absent(n, 1.0), more(n, 1.0);
    bool any = false;
    double length = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const Point p = target.points[i], q = target.points[(i + 1) % n];
        length += std::min(std::hypot(p.x - q.x, p.y - q.y), target.radius);
    }
    const auto shallow = static_cast<std::size_t>(
        std::lower_bound(target.depth.begin(), target.depth.end(), numbers.shallow) - target.depth.begin());
    const int far = whole(numbers.far * 2 * target.radius * static_cast<double>(n) / length, 8, std::max(8, static_cast<int>(n)));
    Beside near;
    Levels back, shift;
    double varied = 0;  // the object's material as it varies here: what is nearly of its level is not of it
    for (std::size_t i = 0; i < n; ++i) {
        if (visible[i] > 0.5) {
            same[i] = seen_odds;
            continue;
        }
        if (bounded[i]) {
            differs[i] = absent[i] = more[i] = bounded_odds;
            continue;
        }
        if (Beside here = beside(i, visible, far); !(here == near)) {
            near = std::move(here);
            back = levels_of(near, beyond);
            shift = levels_of(near, changed);
            varied = levels_of(near, material).spread;
        }
        if (!back.known || !shift.known) continue;
        double own = 0;
        for (int k = 0; k < inner_pixels; ++k) own += target.inner[i * inner_pixels + static_cast<std::size_t>(k)] / inner_pixels;
        own = light.gain * own + light.bias + shift.level;
        Cells own_in, back_in, own_out, back_out;
        for (std::size_t k = 0; k < region_cells; ++k) {
            const std::size_t q = i * region_cells + k;
            own_in[k] = log_cell(material[q], material[q] - changed[q] + shift.level, shift.spread, numbers);
            back_in[k] = log_cell(material[q], back.level, back.spread, numbers);
            own_out[k] = log_cell(beyond[q], own, varied, numbers);
            back_out[k] = log_cell(beyond[q], back.level, back.spread, numbers);
        }
        const double as_inside = mean_cells(own_in, 0, first_cells, 0.0), as_outside = mean_cells(back_out, 0, first_cells, 0.0);
        const double least = std::log(numbers.unlikely);
        const double notch = std::min(closed(back_in, own_in, shallow, least), as_outside);
        const double tab = std::min(closed(own_out, back_out, shallow, least), as_inside);
        const auto ratio = [&](double agreement) {
            return std::exp(std::clamp(numbers.power * agreement, -20.0, 20.0));
        };
        same[i] = ratio(std::min(as_inside, as_outside));
        if (back.between && shift.between) differs[i] = amiss + (1 - amiss) * ratio(std::max(notch, tab));
        absent[i] = amiss + (1 - amiss) * ratio(std::min(mean_cells(back_in, 0, first_cells, least), as_outside));
        more[i] = amiss + (1 - amiss) * ratio(std::min(mean_cells(own_out, 0, first_cells, least), as_inside));
        any = true;
    }
    if (!any) return found;
    for (auto *ratios : {&same, &differs, &absent, &more}) temper(*ratios, power);
    const Chain with = stretches(same, differs, share, stay, true, meeting);
    States without = share;
    without[0] += without[2];
    without[2] = 1e-12;
    const Chain here = stretches(same, differs, without, stay, false, meeting);
    for (std::size_t i = 0; i < n; ++i) found.closed.samples[i] = with.posterior[i][2];
    found.closed.log_odds = with.log_likelihood - here.log_likelihood;
    // ground where the object should be and the object where it should end, without an end of their own: one alone may be cover
    for (const auto *side : {&absent, &more}) {
        const Chain goes_on = stretches(same, *side, share, stay, false, meeting);
        found.open.log_odds += std::clamp(goes_on.log_likelihood - here.log_likelihood, 0.0, -std::log(imitated));
        for (std::size_t i = 0; i < n; ++i) found.open.samples[i] = std::max(found.open.samples[i], goes_on.posterior[i][2]);
    }
    return found;
}

}  // namespace grasptrack::pose
