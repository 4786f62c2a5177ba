// SPDX-License-Identifier: Apache-2.0
// What an image shows where an outline should be and is not. Defined in kernels/reference_contradiction.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "edges.hpp"
#include "outline.hpp"

namespace grasptrack {

constexpr double kAlike = 0.3, kGrain = 0.6, kBeyond = 0.4, kAttached = 0.7, kSlender = 1.3, kDeep = 2.0;
constexpr double kColours[] = {0.1, 0.3, 0.5, 0.7, 0.9};
constexpr int kDirections = 17;  // 10 degrees apart, the middle one along the normal

// Grey levels of pixels, NaN outside the image and where it is hidden; `image_at` sees what is hidden as well.
class Levels {
  public:
    Levels(const Image<std::uint8_t> &image, const std::uint8_t *hidden) : image_(image), hidden_(hidden) {}

    double at(Vec p) const { return of_pixel(p, hidden_); }
    double image_at(Vec p) const { return of_pixel(p, nullptr); }

  private:
    double of_pixel(Vec p, const std::uint8_t *hidden) const {
        const double column = std::nearbyint(p.x), row = std::nearbyint(p.y);
        if (!(column >= 0 && row >= 0 && column < static_cast<double>(image_.width) && row < static_cast<double>(image_.height)))
            return std::numeric_limits<double>::quiet_NaN();
        const auto place = static_cast<std::ptrdiff_t>(row) * image_.width + static_cast<std::ptrdiff_t>(column);
        if (hidden != nullptr && hidden[place] != 0) return std::numeric_limits<double>::quiet_NaN();
        return image_.data[place];
    }

    const Image<std::uint8_t> image_;
    const std::uint8_t *const hidden_;
};

// The outline's samples as they lie in the image: n of them, with the grey levels that are expected on either side.
struct Expected {
    const Vec *points, *normals;
    const double *inside, *outside;
    std::size_t n;
    double reach, size;

    bool told(std::size_t i) const { return std::isfinite(inside[i] + outside[i]); }
};

// The i-th of `count` values from `first` to `last`.
inline double evenly(double first, double last, int count, int i) {
    return i + 1 == count ? last : first + static_cast<double>(i) * ((last - first) / static_cast<double>(count - 1));
}

using Run = std::vector<std::size_t>;

// Samples that follow one another round the outline, with gaps of at most one.
inline std::vector<Run> runs(const Run &index, std::size_t count) {
    std::vector<Run> pieces;
    for (std::size_t i = 0; i < index.size(); ++i) {
        if (i == 0 || index[i] - index[i - 1] > 2) pieces.emplace_back();
        pieces.back().push_back(index[i]);
    }
    if (pieces.size() > 1 && index.front() + count - index.back() <= 2) {
        Run joined = std::move(pieces.back());
        pieces.pop_back();
        joined.insert(joined.end(), pieces.front().begin(), pieces.front().end());
        pieces.front() = std::move(joined);
    }
    return pieces;
}

// Whether what lies beyond samples that follow one another, of the level `low`, ends within `far` px in every direction.
inline bool ends(const Levels &levels, const Expected &outline, const Run &run, double low, double high, double far) {
    const double count = static_cast<double>(run.size()), begin = kDeep * outline.reach;
    const double width = length(outline.points[run.back()] - outline.points[run.front()]) * (1.0 + 1.0 / count);
    const double stop = std::max({far, kSlender * width, begin + 4.0});
    const auto steps = static_cast<int>(std::ceil((stop - begin) / 2.0));
    Vec normal{0, 0}, middle{0, 0};
    for (const std::size_t i : run) normal = normal + outline.normals[i], middle = middle + outline.points[i];
    normal = {normal.x / count, normal.y / count};
    middle = {middle.x / count, middle.y / count};
    const double size = std::max(length(normal), 1e-9);
    for (int k = 0; k < kDirections; ++k) {
        const double angle = static_cast<double>(10 * k - 80) * (3.14159265358979323846 / 180.0);
        const double c = std::cos(angle), s = std::sin(angle);
        const Vec ray{(normal.x * c - normal.y * s) / size, (normal.x * s + normal.y * c) / size};
        bool ended = false;
        for (int i = 0; i < steps && !ended; ++i) {
            const double level = levels.at(middle + (begin + 2.0 * static_cast<double>(i)) * ray);
            ended = std::fabs((level - low) / (high - low)) > kAlike;
        }
        if (!ended) return false;  // out of the image it may go on as well
    }
    return true;
}

inline void contradicted(const Levels &levels, const Expected &outline, const std::vector<char> &missed,
                         std::vector<char> &against) {
    constexpr int depths = 5;
    Run material_like;
    for (std::size_t i = 0; i < outline.n; ++i) {
        if (!missed[i] || !outline.told(i)) continue;
        const double inside = outline.inside[i], contrast = outline.outside[i] - inside;
        double mean = 0.0, change = 0.0;
        bool ground = true, material = true;
        for (int k = 0; k < depths; ++k) {
            const double depth = evenly(1.5, kDeep * outline.reach, depths, k);
            const double within = (levels.at(outline.points[i] - depth * outline.normals[i]) - inside) / contrast;
            const double beyond = (levels.at(outline.points[i] + depth * outline.normals[i]) - inside) / contrast;
            mean += within, change += beyond - within;
            ground = ground && std::fabs(within - 1.0) <= kGrain;
            material = material && std::fabs(beyond) <= kAlike;
        }
        // an edge that is faint, as in shadow, is still there; out of the image there is none
        const bool edge = std::fabs(change / depths) > kAlike;
        // a ground with grain is itself on the whole
        against[i] = ground && !edge && std::fabs(mean / depths - 1.0) <= kAlike;
        if (material && !edge) material_like.push_back(i);
    }
    for (const Run &run : runs(material_like, outline.n)) {
        double low = 0.0, high = 0.0;
        for (const std::size_t i : run) low += outline.inside[i], high += outline.outside[i];
        const double count = static_cast<double>(run.size());
        const bool ended = ends(levels, outline, run, low / count, high / count, kBeyond * outline.size);
        for (const std::size_t i : run) against[i] = ended;
    }
}

// The quantile of values that are sorted.
inline double quantile(const std::vector<double> &sorted, double share) {
    const double place = share * static_cast<double>(sorted.size() - 1);
    const auto below = static_cast<std::size_t>(place);
    if (below + 1 >= sorted.size()) return sorted.back();
    const double rest = place - static_cast<double>(below), a = sorted[below], b = sorted[below + 1];
    return rest < 0.5 ? a + (b - a) * rest : b - (b - a) * (1.0 - rest);
}

inline void attached(const Levels &levels, const Expected &outline, std::vector<char> &against) {
    constexpr int depths = 3, colours = 5;
    std::vector<double> inside, outside;
    for (std::size_t i = 0; i < outline.n; ++i)
        if (outline.told(i)) inside.push_back(outline.inside[i]), outside.push_back(outline.outside[i]);
    if (inside.empty()) return;
    const double ground = median_of(outside);
    std::sort(inside.begin(), inside.end());
    double colour[colours];
    for (int c = 0; c < colours; ++c) colour[c] = quantile(inside, kColours[c]);
    std::vector<double> sums(outline.n, 0.0);
    Run index;
    for (std::size_t i = 0; i < outline.n; ++i) {
        double beyond[depths];
        for (int k = 0; k < depths; ++k) {  // nearer to the outline, other colours come and go
            const double depth = evenly(0.6, 1.0, depths, k) * kDeep * outline.reach;
            beyond[k] = levels.at(outline.points[i] + depth * outline.normals[i]);
            sums[i] += beyond[k];
        }
        bool any = false;
        for (int c = 0; c < colours && !any; ++c) {
            any = true;
            for (int k = 0; k < depths; ++k)
                any = any && std::fabs(beyond[k] - colour[c]) <= kAlike * std::fabs(ground - colour[c]);
        }
        if (any) index.push_back(i);
    }
    for (const Run &run : runs(index, outline.n)) {
        double low = 0.0;
        for (const std::size_t i : run) low += sums[i];
        low /= static_cast<double>(depths * run.size());
        const bool ended = ends(levels, outline, run, low, ground, kAttached * outline.size);
        for (const std::size_t i : run) against[i] = ended;
    }
}

}  // namespace grasptrack
