// SPDX-License-Identifier: Apache-2.0
// Edges along the outline's normals: several candidates a sample, each with how much it looks like the object's own.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "matrix.hpp"
#include "pyramid.hpp"
#include "target.hpp"

namespace grasptrack::pose {

constexpr int most_candidates = 6;
constexpr int farthest = 1000;  // work px within which edges are looked for, whatever is asked for
constexpr int least_half = 2, most_half = 12;  // work px on each side of an edge that are averaged
constexpr double displaced = 0.55;  // of `half`, by noise as strong as the step; as edges drawn at any angle show
constexpr int beyond = 16;      // work px of a profile beyond that, for the filter and for what lies inside an edge
constexpr int most_profile = 2 * (farthest + 2 * most_half) + 1;

struct EdgeSample {
    bool inside = false;
    int count = 0;
    std::array<double, most_candidates> offset{};      // work px along the outward normal
    std::array<double, most_candidates> step{};        // signed, grey levels
    std::array<double, most_candidates> difference{};  // mean square of the inner side's grey levels from the object's own
};

// The part of a profile, -span..span, that is looked at.
struct Part {
    int first, last;
};

// As far as edges within `reach` are told by: their filter, and what lies inside them.
inline Part part_of(int span, int reach, int half) {
    return {std::max(-span, -reach + inner_first - half), std::min(span, reach + half + 2)};
}

// Grey levels along p + k n, for k of a part of -span..span; NaN outside the image. False where the sample itself is outside.
GRASPTRACK_WIDE inline bool profile(const Seen &seen, Point p, Point n, int span, Part part, double *out) {
    const Homography &h = seen.H;
    const double x0 = h[0] * p.x + h[1] * p.y + h[2], x1 = h[0] * n.x + h[1] * n.y;
    const double y0 = h[3] * p.x + h[4] * p.y + h[5], y1 = h[3] * n.x + h[4] * n.y;
    const double w0 = h[6] * p.x + h[7] * p.y + h[8], w1 = h[6] * n.x + h[7] * n.y;
    const auto held = [&](int k) {  // with some room for rounding; by the reciprocal, which of the least w is infinite
        const double s = 1.0 / (w0 + k * w1);
        return s > 0 && seen.level->holds((x0 + k * x1) * s, (y0 + k * y1) * s, 1e-6);
    };
    // what holds both ends holds all between them
    const bool whole = !seen.level->hidden && held(part.first) && held(part.last);
    double x[most_profile], y[most_profile];
    const int length = part.last - part.first + 1;
    for (int i = 0; i < length; ++i) {
        const int k = part.first + i;
        const double s = 1.0 / (w0 + k * w1);
        x[i] = (x0 + k * x1) * s;
        y[i] = (y0 + k * y1) * s;
    }
    double *values = out + span + part.first;
    if (whole) seen.level->at(x, y, length, values);
    else
        for (int i = 0; i < length; ++i)
            values[i] = seen.level->holds(x[i], y[i], 0.0) ? seen.level->at(x[i], y[i]) : std::numeric_limits<double>::quiet_NaN();
    return seen.level->holds(x0 / w0, y0 / w0, 3.0);
}

// Extrema of (mean of `half` px outside - mean of `half` px inside) within `reach`. A wide filter does not displace a
// sharp edge, and finds the middle of a blurred one.
GRASPTRACK_WIDE inline void find_candidates(const double *values, int span, int reach, double noise, int half, EdgeSample &out) {
    const int count = 2 * span + 1;
    const int first = std::max(2, span - reach), last = std::min(count - 3, span + reach);
    // g is needed one px beyond what is searched, and what it is smoothed from, t, two
    const int begin = std::max(half, first - 2), end = std::min(count - half - 1, last + 2);
    double sum[most_profile + 1], t[most_profile], g[most_profile];
    bool cut = false;
    double running = sum[begin - half] = 0.0;
    for (int k = begin - half; k <= end + half; ++k) {
        const bool known = values[k] == values[k];
        cut = cut || !known;
        sum[k + 1] = running += known ? values[k] : 0.0;
    }
    for (int k = first - 2; k <= last + 2; ++k) t[k] = 0.0;
    const double share = 1.0 / half;
    for (int k = begin; k <= end; ++k) t[k] = (sum[k + half + 1] - sum[k + 1] - sum[k] + sum[k - half]) * share;
    for (int k = begin; cut && k <= end; ++k)
        for (int j = k - half; j <= k + half; ++j)
            if (values[j] != values[j]) t[k] = 0.0;
    for (int k = first - 1; k <= last + 1; ++k) g[k] = 0.5 * t[k] + 0.25 * (t[k - 1] + t[k + 1]);
    const double least = 2.5 * noise * std::sqrt(2.0 / half);
    out.count = 0;
    std::int64_t peak[most_profile];
    for (int k = first; k <= last; ++k) {
        const double a = std::abs(g[k]);
        peak[k] = (a > least) & (a >= std::abs(g[k - 1])) & (a > std::abs(g[k + 1])) & (g[k - 1] * g[k] >= 0) & (g[k + 1] * g[k] >= 0);
    }
    for (int k = first; k <= last; ++k) {
        if (!peak[k]) continue;
        const double a = std::abs(g[k]), before = std::abs(g[k - 1]), after = std::abs(g[k + 1]);
        const double bend = before - 2 * a + after;
        const double offset = k - span + (bend != 0 ? 0.5 * (before - after) / bend : 0.0);
        int at = out.count;
        if (at == most_candidates) {
            at = 0;
            for (int j = 1; j < most_candidates; ++j)
                if (std::abs(out.step[static_cast<std::size_t>(j)]) < std::abs(out.step[static_cast<std::size_t>(at)])) at = j;
            if (std::abs(out.step[static_cast<std::size_t>(at)]) >= a) continue;
        } else {
            ++out.count;
        }
        out.offset[static_cast<std::size_t>(at)] = offset;
        out.step[static_cast<std::size_t>(at)] = g[k];
    }
}

// Standard deviation of the edge in the middle of a profile, work px, by the area between its profile and a step: that of a blurred edge is
// sqrt(2 / pi) times its step. `half`: twice what is expected, so that the step is whole beyond; the span is longer by 2. NaN where it cannot be told.
inline double edge_width(const double *values, int span, int half) {
    constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
    const double *v = values + span;
    const double out = 0.5 * (v[half + 1] + v[half + 2]), in = 0.5 * (v[-half - 1] + v[-half - 2]);
    double area = 0.5 * (out - in);
    for (int k = 1; k <= half; ++k) area += out - v[k] + v[-k] - in;
    const double width = std::sqrt(0.5 * 3.14159265358979) * area / (out - in);
    return width > 0 && std::isfinite(width) ? width : nothing;
}

struct Light {
    double gain = 1, bias = 0;
};

constexpr double soft = 25.0;  // grey levels, by which light and what is seen may differ, softly

// Robust gain and bias of the object's surface, reference to current. Where much is covered, the cover is what fits most:
// the light of before, as far as it still explains some of the surface, is believed rather than a jump of the light.
GRASPTRACK_WIDE inline Light surface_light(const Target &target, const Pyramid &pyramid, const Homography &G, const Light &before) {
    std::vector<double> x, y;
    for (std::size_t i = 0; i < target.surface.size(); ++i) {
        const Point p = target.surface[i], q = carried(G, p.x, p.y);
        if (!pyramid[0].holds(q.x, q.y, 1.0)) continue;
        x.push_back(target.surface_value[i]);
        y.push_back(pyramid[0].at(q.x, q.y));
    }
    const std::size_t n = x.size();
    if (n < 30) return before;
    const auto spread = [n](const std::vector<double> &v) {
        double m = 0, s = 0;
        for (double a : v) m += a;
        m /= static_cast<double>(n);
        for (double a : v) s += (a - m) * (a - m);
        return std::sqrt(s / static_cast<double>(n));
    };
    constexpr double flat = 5.0;               // grey levels
    constexpr double jump = 0.3;               // odds that the light is another than before
    const double sx = spread(x);
    const bool varied = sx > flat;
    const auto refined = [&](Light light) {
        for (int round = 0; round < 3; ++round) {
            double sw = 0, mx = 0, my = 0, cross = 0, own = 1e-6;
            std::vector<double> weight(n);
            for (std::size_t i = 0; i < n; ++i) {
                const double r = y[i] - light.gain * x[i] - light.bias, q = 1 + r * r / (soft * soft);
                weight[i] = 1 / (q * q);
                sw += weight[i];
                mx += weight[i] * x[i];
                my += weight[i] * y[i];
            }
            mx /= sw;
            my /= sw;
            for (std::size_t i = 0; i < n; ++i) {
                cross += weight[i] * (x[i] - mx) * (y[i] - my);
                own += weight[i] * (x[i] - mx) * (x[i] - mx);
            }
            if (varied) light.gain = std::clamp(cross / own, 0.3, 3.0);
            light.bias = my - light.gain * mx;
        }
        return light;
    };
    const auto explained = [&](const Light &light) {
        std::size_t count = 0;
        for (std::size_t i = 0; i < n; ++i) count += std::abs(y[i] - light.gain * x[i] - light.bias) < 0.5 * soft;
        return static_cast<double>(count);
    };
    Light fresh;
    if (varied) fresh.gain = std::clamp(spread(y) / sx, 0.4, 2.5);
    std::vector<double> rest(n);
    for (std::size_t i = 0; i < n; ++i) rest[i] = y[i] - fresh.gain * x[i];
    fresh.bias = middle(rest);
    fresh = refined(fresh);
    const Light same = refined(before);
    return jump * explained(fresh) > explained(same) ? fresh : same;
}

// Whether a light is another one than before, so that the object's grey levels are others. What covers all of its surface looks like it.
inline bool is_other_light(const Target &target, const Light &light, const Light &before) {
    double sum = 0;
    for (double value : target.surface_value) sum += (light.gain - before.gain) * value + light.bias - before.bias;
    return std::abs(sum) > 0.5 * soft * static_cast<double>(target.surface_value.size());
}

struct EdgeView {
    int reach = 0;
    double density = 0;  // clutter: candidates for each work px of a normal
    std::vector<int> half;  // px on each side of each sample's edge that were averaged
    std::vector<double> width;  // work px, standard deviation of each sample's edge, where asked for; NaN where it cannot be told
    std::vector<EdgeSample> samples;
};

// All candidates of all samples of an image seen through G, about the places (n) of their edges. `half`: px on each side of an edge that are averaged.
// `widths`: tell how wide edges are as well.
GRASPTRACK_WIDE inline EdgeView measure_edges(const Target &target, const Pyramid &pyramid, const Homography &G,
                              const std::vector<Point> &places, int reach, const std::vector<int> &half, Light light, int most_span, bool widths = false) {
    EdgeView view;
    view.reach = reach;
    view.half = half;
    const std::size_t n = target.points.size();
    view.samples.resize(n);
    if (widths) view.width.resize(n);
    const int span = std::min(most_span, reach + beyond);
    std::vector<double> values(static_cast<std::size_t>(2 * span + 1));
    int inside = 0, found = 0;
    const Seen seen = look_through(pyramid, G, {target.cx, target.cy});
    for (std::size_t i = 0; i < n; ++i) {
        EdgeSample &s = view.samples[i];
        s.inside = profile(seen, places[i], target.normals[i], span, part_of(span, reach, half[i]), values.data());
        if (widths) view.width[i] = edge_width(values.data(), span, half[i]);
        if (!s.inside) continue;
        ++inside;
        find_candidates(values.data(), span, reach, target.noise, half[i], s);
        found += s.count;
        const double *inner = &target.inner[i * inner_pixels];
        for (int c = 0; c < s.count; ++c) {
            double sum = 0;
            const int at = static_cast<int>(std::lround(s.offset[static_cast<std::size_t>(c)]));
            for (int k = 0; k < inner_pixels; ++k) {
                const int q = std::clamp(at + inner_first + k + span - (half[i] - 2), 0, 2 * span);
                const double difference = values[static_cast<std::size_t>(q)] - (light.gain * inner[k] + light.bias);
                if (difference == difference) sum += difference * difference;
            }
            s.difference[static_cast<std::size_t>(c)] = sum / inner_pixels;
        }
    }
    view.density = std::max(0.02, static_cast<double>(found) / std::max(1, inside) / (2 * reach + 1));
    return view;
}

struct EdgeNumbers {
    double miss;            // an edge that is there is not found
    double same_sign;       // its contrast keeps its sign
    double floor;           // work px, model error of an edge
    double inner_spread;    // grey levels, of the object's own inner side from what it was
    double other_spread;    // of anything else
    double sides;           // probability that a thick part's sides are seen as the object, so that its outline is the lower face's
};

// What candidates say wherever the outline is expected, for each sample.
struct EdgeOdds {
    std::vector<std::array<double, most_candidates>> own;  // that a candidate looks like the object's own edge, against clutter
    std::vector<double> other;                             // of an edge of the object elsewhere

    // Log-likelihood ratio of a sample: something else, whose edge lies anywhere, against the object in a pose that is off by `sigma`
    // work px, its edge there or hidden by light, of which neither is more probable.
    double astray(const EdgeView &view, std::size_t i, double sigma) const {
        double here = 0;
        for (std::size_t q = 0; q < static_cast<std::size_t>(view.samples[i].count); ++q) {
            const double z = view.samples[i].offset[q] / sigma;
            here += own[i][q] * std::exp(-0.5 * z * z);
        }
        here /= std::sqrt(2 * 3.14159265358979) * sigma;
        return std::log(other[i] / (0.5 + 0.5 * here));
    }
};

inline void edge_odds(const Target &target, const EdgeView &view, const EdgeNumbers &numbers, EdgeOdds &out) {
    const std::size_t n = target.points.size();
    out.own.resize(n);
    out.other.assign(n, 1.0);
    const double s = numbers.inner_spread, sc = numbers.other_spread;
    const double base = 1.5 * std::log(sc / s), slope = 0.75 * (1 / (s * s) - 1 / (sc * sc));
    const double signs[2] = {2 * (1 - numbers.same_sign) / view.density, 2 * numbers.same_sign / view.density};
    for (std::size_t i = 0; i < n; ++i) {
        const EdgeSample &e = view.samples[i];
        if (!e.inside) continue;
        double sum = 0;
        for (std::size_t q = 0; q < static_cast<std::size_t>(e.count); ++q) {
            const double looks = std::exp(std::clamp(base - slope * e.difference[q], -8.0, 8.0));
            out.own[i][q] = looks * signs[(e.step[q] > 0) == (target.contrast[i] > 0)];
            sum += out.own[i][q];
        }
        out.other[i] = numbers.miss + (1 - numbers.miss) * sum / (2 * view.reach + 1);
    }
}

struct EdgeLikelihoods {
    std::vector<double> object;         // for each sample: its edge here; clutter is 1
    std::vector<double> upper, lower;   // probability that the upper, or the lower face's edge was seen
    std::vector<double> upper_offset, lower_offset;
};

// `shift`: where each sample's edge is expected; `low`, `low_variance`: how far out the lower face's lies.
GRASPTRACK_WIDE inline void edge_likelihoods(const Target &target, const EdgeView &view, const EdgeOdds &odds, const std::vector<double> &shift,
                             const std::vector<double> &low, const std::vector<double> &low_variance, const Matrix<8> &P,
                             const EdgeNumbers &numbers, EdgeLikelihoods &out) {
    const std::size_t n = target.points.size();
    out.object.assign(n, 1.0);
    for (auto *v : {&out.upper, &out.lower, &out.upper_offset, &out.lower_offset}) v->assign(n, 0.0);
    const Form<8> spread(P);
    const double found = 1 - numbers.miss;
    constexpr double circle = 2 * 3.14159265358979;
    for (std::size_t i = 0; i < n; ++i) {
        const EdgeSample &e = view.samples[i];
        if (!e.inside) continue;
        // noise displaces a wide edge by more, in the reference as here
        const double half = view.half[i], shake = displaced * target.noise / std::max(std::abs(target.contrast[i]), 1e-9);
        const double own = shake * shake * (target.half * target.half + half * half);
        const double variance = numbers.floor * numbers.floor + own + spread(target.squares[i]);
        const bool two = std::abs(low[i]) + std::sqrt(low_variance[i]) > 0.05;
        const double top = (two ? 1 - numbers.sides : 1.0) / std::sqrt(circle * variance), narrow = -0.5 / variance;
        double up = 0, down = 0, up_at = 0, down_at = 0;
        for (std::size_t q = 0; q < static_cast<std::size_t>(e.count); ++q) {
            const double x = e.offset[q] - shift[i], N = top * std::exp(narrow * x * x) * odds.own[i][q];
            up += N;
            up_at += N * e.offset[q];
        }
        if (two) {
            const double wide = variance + low_variance[i], peak = numbers.sides / std::sqrt(circle * wide), flat = -0.5 / wide;
            for (std::size_t q = 0; q < static_cast<std::size_t>(e.count); ++q) {
                const double x = e.offset[q] - shift[i] - low[i], L = peak * std::exp(flat * x * x) * odds.own[i][q];
                down += L;
                down_at += L * e.offset[q];
            }
        }
        out.object[i] = numbers.miss + found * (up + down);
        out.upper[i] = found * up / out.object[i];
        out.lower[i] = found * down / out.object[i];
        out.upper_offset[i] = up > 0 ? up_at / up : 0.0;
        out.lower_offset[i] = down > 0 ? down_at / down : 0.0;
    }
}

}  // namespace grasptrack::pose
