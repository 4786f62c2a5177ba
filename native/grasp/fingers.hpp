// SPDX-License-Identifier: Apache-2.0
// What of an outline lies in the rectangle that a finger sweeps.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "../geometry/points.hpp"

namespace grasptrack {

constexpr double within_pad = 1 - 1e-9;  // of half the width: what only touches a finger's side is not in its way

struct Box {
    double left, right, top, bottom;

    explicit Box(Vec p) : left(p.x), right(p.x), top(p.y), bottom(p.y) {}
    void hold(Vec p) {
        left = std::min(left, p.x), right = std::max(right, p.x);
        top = std::min(top, p.y), bottom = std::max(bottom, p.y);
    }
    bool apart(const Box &other) const {
        return right < other.left || other.right < left || bottom < other.top || other.bottom < top;
    }
};

// An outline with a box round every few of its segments.
class Boxed {
  public:
    static constexpr std::size_t few = 16;
    struct Block {
        std::size_t contour, first, last;
        Box box;
    };

    explicit Boxed(const Outline &outline) : outline_(outline) {
        for (std::size_t c = 0; c < outline.contours; ++c) {
            const Points contour = outline.contour(c);
            for (std::size_t i = 0; i < contour.size; i += few) {
                Block block{c, i, std::min(i + few, contour.size), Box(contour[i])};
                for (std::size_t j = i; j < block.last; ++j) {
                    const Vec next = contour[j + 1 < contour.size ? j + 1 : 0];
                    block.box.hold(next);
                    sides_.push_back(length(next - contour[j]));
                }
                blocks_.push_back(block);
            }
        }
    }

    template <typename Use> void each_segment(const Box &box, Use use) const {
        for (const Block &block : blocks_) {
            if (block.box.apart(box)) continue;
            const Points contour = outline_.contour(block.contour);
            for (std::size_t j = block.first; j < block.last; ++j)
                use(block.contour, j, contour[j], contour[j + 1 < contour.size ? j + 1 : 0]);
        }
    }

    // Even-odd, so that holes are outside.
    bool holds(Vec at) const {
        Box ray(at);
        ray.right = std::numeric_limits<double>::infinity();
        bool inside = false;
        each_segment(ray, [&](std::size_t, std::size_t, Vec p, Vec q) {
            if ((p.y > at.y) != (q.y > at.y) && at.x < p.x + (at.y - p.y) / (q.y - p.y) * (q.x - p.x)) inside = !inside;
        });
        return inside;
    }

    const Outline &outline() const { return outline_; }

    // Lengths of a contour's segments.
    const double *sides(std::size_t contour) const { return sides_.data() + outline_.offsets[contour]; }

  private:
    Outline outline_;
    std::vector<Block> blocks_;
    std::vector<double> sides_;
};

// The segments of one contour that lie under a pad: a run that may go round the first point.
struct UnderPad {
    std::size_t contour = 0, first = 0, count = 0, size = 1;

    UnderPad() = default;
    UnderPad(std::size_t index, const Place &place, const double *sides, double reach)
        : contour(index), first(place.i), count(1), size(place.contour.size) {
        const double own = sides[place.i];
        double ahead = reach - (1 - place.fraction) * own, behind = reach - place.fraction * own;
        for (std::size_t i = place.following(); ahead > 0 && count < size; i = i + 1 < size ? i + 1 : 0) {
            ahead -= sides[i];
            ++count;
        }
        while (behind > 0 && count < size) {
            first = first > 0 ? first - 1 : size - 1;
            behind -= sides[first];
            ++count;
        }
    }

    bool holds(std::size_t index, std::size_t segment) const {
        return count > 0 && index == contour && (segment + size - first) % size < count;
    }
};

struct FingerRoom {
    double protrusion, nearest;
};

inline FingerRoom finger_room(const Boxed &boxed, Vec contact, Vec direction, const UnderPad &under, double width,
                              double depth) {
    constexpr double never = std::numeric_limits<double>::infinity();
    FingerRoom room{0.0, never};
    const double half = width / 2 * within_pad, least = 1e-9 * width;
    if (!(depth > least)) return room;
    const Vec across{-direction.y, direction.x};
    Box box(contact + (width / 2) * across);
    box.hold(contact - (width / 2) * across);
    box.hold(contact + (width / 2) * across - depth * direction);
    box.hold(contact - (width / 2) * across - depth * direction);
    boxed.each_segment(box, [&](std::size_t c, std::size_t i, Vec from, Vec to) {
        const Vec a = from - contact, b = to - contact;
        const double px = dot(a, across), py = -dot(a, direction), qx = dot(b, across), qy = -dot(b, direction);
        if ((px >= half && qx >= half) || (px <= -half && qx <= -half)) return;
        double start = 0, end = 1;
        if (px != qx) {
            const double t = (-half - px) / (qx - px), u = (half - px) / (qx - px);
            start = std::max(start, std::min(t, u)), end = std::min(end, std::max(t, u));
        }
        const double y0 = py + start * (qy - py), y1 = py + end * (qy - py);
        const double low = std::min(y0, y1), high = std::max(y0, y1);
        if (!(high > least && low < depth)) return;
        if (under.holds(c, i))
            room.protrusion = std::max(room.protrusion, high);
        else
            room.nearest = std::min(room.nearest, std::max(low, 0.0));
    });
    if (room.nearest == never && boxed.holds(contact - depth * direction)) room.nearest = 0.0;
    return room;
}

}  // namespace grasptrack
