// SPDX-License-Identifier: Apache-2.0
// Edges of an image, sub-pixel, along the normals of a curve.
#pragma once

#include <algorithm>
#include <limits>
#include <type_traits>
#include <vector>

#include "../geometry/points.hpp"

namespace grasptrack {

constexpr double spacing = 0.5;  // px between samples
constexpr double window = 3.0;   // px on either side of the edge whose gradients count, ever less outward
constexpr double away = 1.5;     // px from the edge where its two sides begin
constexpr double settled = 1e-3;  // px; Newton's steps halve their digits, so that the next would change nothing
constexpr std::ptrdiff_t min_samples = 7;

template <typename Pixel> struct Image {
    const Pixel *data;
    std::ptrdiff_t height, width;

    bool holds(Vec p) const {
        return p.x >= 0 && p.y >= 0 && p.x <= static_cast<double>(width - 1) && p.y <= static_cast<double>(height - 1);
    }

    // With all four pixels that a sample there is made of.
    bool surrounds(Vec p) const {
        return p.x >= 0 && p.y >= 0 && p.x < static_cast<double>(width - 1) && p.y < static_cast<double>(height - 1);
    }

    double sample(Vec p) const {
        const auto x = static_cast<std::ptrdiff_t>(p.x), y = static_cast<std::ptrdiff_t>(p.y);
        const double fx = p.x - static_cast<double>(x), fy = p.y - static_cast<double>(y);
        // On the last column or row the fraction is 0, and the pixel stands for its missing neighbour.
        const std::ptrdiff_t right = x + 1 < width ? 1 : 0, down = y + 1 < height ? width : 0;
        const Pixel *at = data + y * width + x;
        const double a = at[0], b = at[right], c = at[down], d = at[down + right];
        const double top = a + fx * (b - a), bottom = c + fx * (d - c);
        return top + fy * (bottom - top);
    }
};

// Grey levels v[first..last] at `at + j spacing along`, whose both ends have all four pixels in the image. In runs, so that
// what can be done for several at once is.
template <typename Pixel>
void sample_run(const Image<Pixel> &image, Vec at, Vec along, std::ptrdiff_t first, std::ptrdiff_t last, double *v) {
    constexpr int most = 32;
    double fx[most], fy[most];
    std::int32_t column[most], row[most];
    std::conditional_t<std::is_integral_v<Pixel>, std::int32_t, double> a[most], b[most], c[most], d[most];
    for (std::ptrdiff_t start = first; start <= last; start += most) {
        const int count = static_cast<int>(std::min<std::ptrdiff_t>(most, last - start + 1));
        const auto from = static_cast<std::int32_t>(start);
        for (int i = 0; i < count; ++i) {
            const double distance = spacing * static_cast<double>(from + i);
            const double x = at.x + distance * along.x, y = at.y + distance * along.y;
            column[i] = static_cast<std::int32_t>(x), row[i] = static_cast<std::int32_t>(y);
            fx[i] = x - static_cast<double>(column[i]), fy[i] = y - static_cast<double>(row[i]);
        }
        for (int i = 0; i < count; ++i) {
            const Pixel *pixel = image.data + row[i] * image.width + column[i];
            a[i] = pixel[0], b[i] = pixel[1], c[i] = pixel[image.width], d[i] = pixel[image.width + 1];
        }
        for (int i = 0; i < count; ++i) {
            const double left = a[i], lower = c[i];
            const double top = left + fx[i] * static_cast<double>(b[i] - a[i]);
            const double bottom = lower + fx[i] * static_cast<double>(d[i] - c[i]);
            v[start + i] = top + fy[i] * (bottom - top);
        }
    }
}

struct Edge {
    double offset = std::numeric_limits<double>::quiet_NaN(), strength = 0;
    double inside = std::numeric_limits<double>::quiet_NaN(), outside = std::numeric_limits<double>::quiet_NaN();
};

// Samples along a normal, spacing px apart: sample j in [first, last] is v[j], j = 0 at the point itself.
struct Profile {
    const double *v;
    std::ptrdiff_t first, last;

    static double at(std::ptrdiff_t j) { return spacing * static_cast<double>(j); }
    double slope(std::ptrdiff_t j) const { return (v[j + 1] - v[j - 1]) / (2 * spacing); }

    // Index of the strongest slope as asked for; `first` where there is none, or where it is at an end, so that the edge
    // may lie beyond.
    std::ptrdiff_t peak(int polarity) const {
        const auto most = [&](auto score) {
            double best = 0;
            std::ptrdiff_t peak = first;
            for (std::ptrdiff_t j = first + 1; j < last; ++j)
                if (const double g = score(slope(j)); g > best) best = g, peak = j;
            return peak;
        };
        const std::ptrdiff_t peak = polarity == 0  ? most([](double g) { return std::fabs(g); })
                                    : polarity > 0 ? most([](double g) { return g; })
                                                   : most([](double g) { return -g; });
        return peak == first + 1 || peak == last - 1 ? first : peak;
    }

    // Where gradients of one sign balance under the weight u (1 - u^2), u = (x - centre) / window: near `peak`, by
    // Newton's steps. A weight that fades out does not feel where the samples lie.
    double centre(double sign, double peak) const {
        // All that any window about a centre within 1 px of the peak can hold, and as much that counts nothing.
        constexpr std::ptrdiff_t most = static_cast<std::ptrdiff_t>(2 * (window + 1) / spacing) + 2;
        constexpr std::ptrdiff_t wide = (static_cast<std::ptrdiff_t>(2 * window / spacing) + 3) / 2 * 2;
        const auto start = std::max(static_cast<std::ptrdiff_t>((peak - window - 1) / spacing) - 1, first);
        const auto stop = std::min(start + most - 1, last - 1);
        const auto count = stop - start + 1;
        double gradient[most + wide];
        for (std::ptrdiff_t i = 0; i < count; ++i) gradient[i] = std::max(sign * (v[start + i + 1] - v[start + i]), 0.0);
        for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(count, 0); i < most + wide; ++i) gradient[i] = 0.0;
        constexpr double step = spacing / window;
        const double origin = step * (static_cast<double>(start) + 0.5);
        double centre = peak;
        for (int round = 0; round < 3; ++round) {
            // The first that the window holds, or one before it.
            const auto ahead = static_cast<std::ptrdiff_t>((centre - window) / spacing - 0.5 - static_cast<double>(start));
            const auto begin = std::min(std::max<std::ptrdiff_t>(ahead, 0), most) / 2 * 2;
            const double nearest = origin + step * static_cast<double>(begin) - centre / window;
            double mass[2] = {0, 0}, moment[2] = {0, 0}, within[2] = {0, 0};  // two lanes, for the vector unit
            for (int i = 0; i < wide; i += 2)
                for (int lane = 0; lane < 2; ++lane) {
                    const double u = nearest + step * (i + lane), fade = std::max(1 - u * u, 0.0);
                    const double here = gradient[begin + i + lane], weighted = fade * here;
                    mass[lane] += weighted;
                    moment[lane] += weighted * u;
                    within[lane] += fade > 0 ? here : 0.0;
                }
            // 1 - 3 u^2 is 3 (1 - u^2) - 2
            const double total = mass[0] + mass[1], rate = 3 * total - 2 * (within[0] + within[1]);
            const double before = centre;
            centre += window * (moment[0] + moment[1]) / std::max(rate, 0.2 * total);
            centre = std::min(std::max(centre, peak - 1), peak + 1);
            if (std::fabs(centre - before) < settled) break;
        }
        return centre;
    }

    Edge edge(double offset, double strength) const {
        // Samples up to `low` lie inside, from `high` on outside.
        const auto low = std::min(static_cast<std::ptrdiff_t>(std::floor((offset - away) / spacing)), last);
        const auto high = std::max(static_cast<std::ptrdiff_t>(std::ceil((offset + away) / spacing)), first);
        double inside = 0, outside = 0;
        for (std::ptrdiff_t j = first; j <= low; ++j) inside += v[j];
        for (std::ptrdiff_t j = high; j <= last; ++j) outside += v[j];
        return {offset, strength, low >= first ? inside / static_cast<double>(low - first + 1) : v[first],
                high <= last ? outside / static_cast<double>(last - high + 1) : v[last]};
    }
};

template <typename Pixel>
void search_along_normals(const Image<Pixel> &image, Points points, const Vec *normals, double reach, int polarity, Edge *out) {
    const auto half = static_cast<std::ptrdiff_t>(reach / spacing + 1e-9);
    // Beyond its reach an edge is not looked for, but the window of one found near the end needs its samples.
    constexpr auto margin = static_cast<std::ptrdiff_t>((window + 1) / spacing) + 1;
    std::vector<double> samples(static_cast<std::size_t>(2 * (half + margin) + 1));
    double *v = samples.data() + half + margin;
    for (std::size_t k = 0; k < points.size; ++k) {
        const auto place = [&](std::ptrdiff_t j) { return points[k] + Profile::at(j) * normals[k]; };
        const auto take = [&](std::ptrdiff_t j) {
            const Vec p = place(j);
            if (!image.holds(p)) return false;
            v[j] = image.sample(p);
            return true;
        };
        const auto finite = [&](const Profile &p) {
            if constexpr (std::is_integral_v<Pixel>) return true;
            return std::all_of(p.v + p.first, p.v + p.last + 1, [](double level) { return std::isfinite(level); });
        };
        out[k] = Edge{};
        // The image is convex, so that what lies in it is one run.
        Profile profile{v, -half, half};
        std::ptrdiff_t from = -std::max(half, margin), to = -from;  // more than is searched: one run costs less than three
        if (image.surrounds(place(from)) && image.surrounds(place(to))) {
            sample_run(image, points[k], normals[k], from, to, v);
        } else if (from = -half, to = half; image.surrounds(place(-half)) && image.surrounds(place(half))) {
            sample_run(image, points[k], normals[k], -half, half, v);
        } else {
            while (profile.first <= half && !take(profile.first)) ++profile.first;
            for (std::ptrdiff_t j = profile.first + 1; j <= half; ++j)
                if (!take(j)) {
                    profile.last = j - 1;
                    break;
                }
            from = profile.first, to = profile.last;
        }
        if (profile.last - profile.first + 1 < min_samples || !finite(profile)) continue;
        const std::ptrdiff_t peak = profile.peak(polarity);
        if (peak == profile.first) continue;
        const double strength = profile.slope(peak);
        Profile wide = profile;
        if (image.surrounds(place(peak - margin)) && image.surrounds(place(peak + margin))) {
            wide.first = std::min(wide.first, peak - margin), wide.last = std::max(wide.last, peak + margin);
            sample_run(image, points[k], normals[k], wide.first, from - 1, v);
            sample_run(image, points[k], normals[k], to + 1, wide.last, v);
        }
        while (wide.first > peak - margin && take(wide.first - 1)) --wide.first;
        while (wide.last < peak + margin && take(wide.last + 1)) ++wide.last;
        if (!finite(wide)) continue;
        out[k] = profile.edge(wide.centre(strength > 0 ? 1.0 : -1.0, Profile::at(peak)), strength);
    }
}

}  // namespace grasptrack
