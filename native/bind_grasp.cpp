// SPDX-License-Identifier: Apache-2.0
// The kernels of synthesis in Python.

#include "bind_grasp.hpp"

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "fingers.hpp"
#include "opposed.hpp"
#include "ranking.hpp"
#include "triples.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using GraspArray = Input<std::int64_t, 2>;

nb::tuple py_opposed_pairs(const PointArray &contacts, const PointArray &normals, const ValueArray &worth,
                           std::int64_t group, double friction) {
    const std::size_t m = contacts.shape(0);
    if (normals.shape(0) != m || worth.shape(0) != m)
        throw std::invalid_argument("each candidate needs its normal and its worth");
    if (group < 1 || m % static_cast<std::size_t>(group) != 0)
        throw std::invalid_argument("candidates must fill their groups");
    if (!(friction > 0 && std::isfinite(friction)))
        throw std::invalid_argument("friction must be above 0, not " + number(friction));
    const auto found = opposed_pairs(points_of(contacts), vectors(normals), worth.data(),
                                     static_cast<std::size_t>(group), friction);
    OutputOf<std::int64_t> pairs(found.size(), 2);
    Output sense(found.size()), need(found.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
        pairs.values()[2 * i] = found[i].first, pairs.values()[2 * i + 1] = found[i].second;
        sense.values()[i] = found[i].sense, need.values()[i] = found[i].friction;
    }
    return nb::make_tuple(pairs.array(), sense.array(), need.array());
}

nb::tuple py_closing_triples(const PointArray &contacts, const PointArray &normals, double cx, double cy, double rho,
                             double friction) {
    if (normals.shape(0) != contacts.shape(0)) throw std::invalid_argument("each candidate needs its normal");
    if (!(rho > 0 && friction > 0 && std::isfinite(friction)))
        throw std::invalid_argument("rho and friction must be above 0, not " + number(rho) + " and " + number(friction));
    const auto found = closing_triples(points_of(contacts), vectors(normals), {cx, cy}, rho, friction);
    OutputOf<std::int64_t> triples(found.size(), 3);
    Output sense(found.size()), epsilon(found.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
        std::copy(found[i].index.begin(), found[i].index.end(), triples.values() + 3 * i);
        sense.values()[i] = found[i].sense, epsilon.values()[i] = found[i].epsilon;
    }
    return nb::make_tuple(triples.array(), sense.array(), epsilon.array());
}

nb::object py_finger_clearance(const PointArray &points, const IndexArray &offsets, const PointArray &contacts,
                           const PointArray &directions, const std::optional<RowArray> &places, double width,
                           double depth, double reach) {
    const std::size_t count = contacts.shape(0);
    if (directions.shape(0) != count || (places && count_places(*places) != count))
        throw std::invalid_argument("each contact needs its direction and its place");
    if (!(width > 0 && std::isfinite(width) && depth >= 0 && std::isfinite(depth) && reach >= 0 && std::isfinite(reach)))
        throw std::invalid_argument("width must be above 0, depth and reach at least 0, not " + number(width) + ", " +
                                    number(depth) + " and " + number(reach));
    const Outline outline = outline_of(points, offsets);
    const Boxed boxed(outline);
    Output out(count, 2);
    for (std::size_t k = 0; k < count; ++k) {
        UnderPad under;
        if (places) {
            const Place place = place_of(outline, *places, k);
            const auto contour = static_cast<std::size_t>(places->data()[k * places->shape(1)]);
            under = UnderPad(contour, place, boxed.sides(contour), reach);
        }
        const FingerRoom room = finger_room(boxed, vectors(contacts)[k], vectors(directions)[k], under, width, depth);
        out.values()[2 * k] = room.protrusion, out.values()[2 * k + 1] = room.nearest;
    }
    return out.array();
}

nb::tuple py_rank_grasps(const PointArray &contacts, const PointArray &normals, const FlagArray &usable,
                         const IndexArray &starts, const ValueArray &steps, const GraspArray &grasps,
                         const ValueArray &strength, const ValueArray &bound, double friction, double cx, double cy,
                         double rho, double most, double gap, std::int64_t top) {
    const std::size_t m = contacts.shape(0), count = grasps.shape(0), fingers = grasps.shape(1);
    if (normals.shape(0) != m || usable.shape(0) != m)
        throw std::invalid_argument("each candidate needs its normal and its flag");
    outline_of(contacts, starts);
    if (steps.shape(0) + 1 != starts.shape(0)) throw std::invalid_argument("each contour needs its step");
    if ((fingers != 2 && fingers != 3) || strength.shape(0) != count || bound.shape(0) != count)
        throw std::invalid_argument("grasps have 2 or 3 contacts, each grasp its strength and its bound");
    for (std::size_t i = 0; i < count * fingers; ++i)
        if (grasps.data()[i] < 0 || grasps.data()[i] >= static_cast<std::int64_t>(m))
            throw std::invalid_argument("index out of range");
    if (!(friction > 0 && rho > 0 && most > 0 && gap >= 0 && top >= 0))
        throw std::invalid_argument("friction, rho and most must be above 0, gap and top at least 0");
    const Along along(points_of(contacts), vectors(normals), usable.data(), starts.data(), steps.data(), steps.shape(0),
                      friction, {cx, cy}, rho);
    const auto best = Ranking(along, grasps.data(), fingers, strength.data(), most, gap)
                          .best(bound.data(), count, static_cast<std::size_t>(top));
    OutputOf<std::int64_t> chosen(best.size());
    Output quality(best.size()), regions(best.size(), fingers);
    for (std::size_t i = 0; i < best.size(); ++i) {
        chosen.values()[i] = best[i].index, quality.values()[i] = best[i].quality;
        std::copy(best[i].regions.begin(), best[i].regions.begin() + fingers, regions.values() + i * fingers);
    }
    return nb::make_tuple(chosen.array(), quality.array(), regions.array());
}

}  // namespace

void bind_grasp(nb::module_ &m) {
    m.def("closing_triples", &py_closing_triples, "contacts"_a, "normals"_a, "cx"_a, "cy"_a, "rho"_a, "friction"_a);
    m.def("finger_clearance", &py_finger_clearance, "points"_a, "offsets"_a, "contacts"_a, "directions"_a, "places"_a.none(),
          "width"_a, "depth"_a, "reach"_a);
    m.def("opposed_pairs", &py_opposed_pairs, "contacts"_a, "normals"_a, "worth"_a, "group"_a, "friction"_a);
    m.def("rank_grasps", &py_rank_grasps, "contacts"_a, "normals"_a, "usable"_a, "starts"_a, "steps"_a, "grasps"_a,
          "strength"_a, "bound"_a, "friction"_a, "cx"_a, "cy"_a, "rho"_a, "most"_a, "gap"_a, "top"_a);
}

}  // namespace grasptrack
