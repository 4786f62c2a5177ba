// SPDX-License-Identifier: Apache-2.0
// Edges of an image, sub-pixel, along the normals of a curve.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "geometry.hpp"

namespace grasptrack {

constexpr double spacing = 0.5;  // px between samples
constexpr double window = 2.0;   // px on either side of the edge whose gradients count
constexpr double away = 1.5;     // px from the edge where its two sides begin
constexpr std::ptrdiff_t min_samples = 7;

template <typename Pixel> struct Image {
    const Pixel *data;
    std::ptrdiff_t height, width;

    bool holds(Vec p) const {
        return p.x >= 0 && p.y >= 0 && p.x <= static_cast<double>(width - 1) && p.y <= static_cast<double>(height - 1);
    }

    double sample(Vec p) const {
        const std::ptrdiff_t x = std::min(static_cast<std::ptrdiff_t>(p.x), std::max<std::ptrdiff_t>(width - 2, 0));
        const std::ptrdiff_t y = std::min(static_cast<std::ptrdiff_t>(p.y), std::max<std::ptrdiff_t>(height - 2, 0));
        const double fx = p.x - static_cast<double>(x), fy = p.y - static_cast<double>(y);
        const std::ptrdiff_t right = width > 1 ? 1 : 0, down = height > 1 ? width : 0;
        const Pixel *at = data + y * width + x;
        const double a = at[0], b = at[right], c = at[down], d = at[down + right];
        const double top = a + fx * (b - a), bottom = c + fx * (d - c);
        return top + fy * (bottom - top);
    }
};

struct Edge {
    double offset = std::numeric_limits<double>::quiet_NaN(), strength = 0;
    double inside = std::numeric_limits<double>::quiet_NaN(), outside = std::numeric_limits<double>::quiet_NaN();
};

// Samples v at start + spacing * i, i in [0, count).
struct Profile {
    const double *v;
    std::ptrdiff_t count;
    double start;

    double at(std::ptrdiff_t i) const { return start + spacing * static_cast<double>(i); }
    double slope(std::ptrdiff_t i) const { return (v[i + 1] - v[i - 1]) / (2 * spacing); }
    double gradient(std::ptrdiff_t i, double sign) const {
        if (i < 0 || i + 1 >= count) return 0.0;
        return std::max(sign * (v[i + 1] - v[i]), 0.0) / spacing;
    }

    // Where the window's centroid of the gradients of one sign is its own centre: the edge, near `peak`.
    double centre(double sign, double peak) const {
        double centre = peak;
        for (int round = 0; round < 3; ++round) {
            const double low = centre - window, high = centre + window;
            const auto first = static_cast<std::ptrdiff_t>(std::floor((low - start) / spacing));
            const auto last = static_cast<std::ptrdiff_t>(std::floor((high - start) / spacing));
            double mass = 0, moment = 0;
            for (std::ptrdiff_t i = first; i <= last; ++i) {
                const double left = std::max(at(i), low), right = std::min(at(i) + spacing, high);
                const double part = gradient(i, sign) * (right - left);
                mass += part;
                moment += part * ((left + right) / 2 - centre);
            }
            const double mean = moment / mass;
            // The centroid follows the window at this rate; the step is Newton's on centroid - centre.
            const double rate =
                ((window - mean) * gradient(last, sign) + (window + mean) * gradient(first, sign)) / mass;
            centre += mean / std::max(1.0 - rate, 0.2);
            centre = std::min(std::max(centre, peak - 1.0), peak + 1.0);
        }
        return centre;
    }

    Edge strongest(int polarity) const {
        double best = 0, strength = 0;
        std::ptrdiff_t peak = -1;
        for (std::ptrdiff_t i = 1; i + 1 < count; ++i) {
            const double g = slope(i);
            const double score = polarity == 0 ? std::fabs(g) : (polarity > 0 ? g : -g);
            if (score > best) best = score, strength = g, peak = i;
        }
        // At the end of the profile the edge may lie beyond.
        if (peak <= 1 || peak == count - 2) return {};
        const double offset = centre(strength > 0 ? 1.0 : -1.0, at(peak));
        double inside = 0, outside = 0;
        std::ptrdiff_t n_inside = 0, n_outside = 0;
        for (std::ptrdiff_t i = 0; i < count; ++i) {
            if (at(i) <= offset - away) inside += v[i], ++n_inside;
            if (at(i) >= offset + away) outside += v[i], ++n_outside;
        }
        return {offset, strength, n_inside > 0 ? inside / static_cast<double>(n_inside) : v[0],
                n_outside > 0 ? outside / static_cast<double>(n_outside) : v[count - 1]};
    }
};

template <typename Pixel>
void edge_search(const Image<Pixel> &image, Points points, const Vec *normals, double reach, int polarity, Edge *out) {
    const auto half = static_cast<std::ptrdiff_t>(reach / spacing + 1e-9);
    std::vector<double> samples(static_cast<std::size_t>(2 * half + 1));
    for (std::size_t k = 0; k < points.size; ++k) {
        std::ptrdiff_t count = 0, first = -half;
        for (std::ptrdiff_t j = -half; j <= half; ++j) {
            const double along = spacing * static_cast<double>(j);
            const Vec p = points[k] + along * normals[k];
            // The image is convex, so that what lies in it is one run.
            if (!image.holds(p)) {
                if (count > 0) break;
                continue;
            }
            if (count == 0) first = j;
            samples[static_cast<std::size_t>(count++)] = image.sample(p);
        }
        const Profile profile{samples.data(), count, spacing * static_cast<double>(first)};
        out[k] = count < min_samples ? Edge{} : profile.strongest(polarity);
    }
}

}  // namespace grasptrack
