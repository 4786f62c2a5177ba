// SPDX-License-Identifier: Apache-2.0
// Contacts, their closure and the synthesis of grasps, in Python.

#include <nanobind/stl/tuple.h>

#include "../arrays.hpp"
#include "../geometry/homography.hpp"
#include "../geometry/places.hpp"
#include "closure.hpp"
#include "contact.hpp"
#include "fingers.hpp"
#include "ranking.hpp"

namespace grasptrack {

namespace {

// Of grasptrack.kernels.results.RankedCandidates, WrenchSpace and RankingLimits.
using Candidates = std::tuple<PointArray, PointArray, FlagArray, IndexArray, ValueArray>;
using WrenchSpace = std::tuple<double, double, double, double>;
using RankingLimits = std::tuple<double, double, std::int64_t>;

nb::object rank_grasps_(const Candidates &candidates, const Input<std::int64_t, nb::ndim<2>> &grasps, const ValueArray &strength,
                        const ValueArray &bound, const WrenchSpace &space, const RankingLimits &limits) {
    static const Record record("RankedGrasps");
    const auto &[contacts, normals, usable, starts, steps] = candidates;
    const auto [friction, cx, cy, rho] = space;
    const auto [most, gap, top] = limits;
    const std::size_t m = contacts.shape(0), count = grasps.shape(0), fingers = grasps.shape(1);
    if (normals.shape(0) != m || usable.shape(0) != m)
        throw std::invalid_argument("each candidate needs its normal and its flag");
    outline_of(contacts, starts);
    if (steps.shape(0) + 1 != starts.shape(0)) throw std::invalid_argument("each contour needs its step");
    if ((fingers != 2 && fingers != 3) || strength.shape(0) != count || bound.shape(0) != count)
        throw std::invalid_argument("grasps have 2 or 3 contacts, each grasp its strength and its bound");
    check_indices(grasps.data(), count * fingers, m);
    if (!(friction > 0 && rho > 0 && most > 0 && std::isfinite(most) && gap >= 0 && top >= 0))
        throw std::invalid_argument("friction, rho and most must be above 0, gap and top at least 0");
    for (std::size_t c = 0; c < steps.shape(0); ++c)
        if (!(steps.data()[c] > 0 && std::isfinite(steps.data()[c]))) throw std::invalid_argument("steps must be above 0");
    check_finite(strength, "strength");
    check_finite(bound, "bound");
    const Along along(points_of(contacts), vectors(normals), usable.data(), starts.data(), steps.data(), steps.shape(0),
                      friction, {cx, cy}, rho);
    const auto best = Ranking(along, grasps.data(), fingers, strength.data(), most, gap)
                          .best(bound.data(), count, static_cast<std::size_t>(top));
    Output<std::int64_t> chosen(best.size());
    Output<> quality(best.size()), regions(best.size(), fingers);
    for (std::size_t i = 0; i < best.size(); ++i) {
        chosen.values()[i] = best[i].index, quality.values()[i] = best[i].quality;
        std::copy(best[i].regions.begin(), best[i].regions.begin() + fingers, regions.values() + i * fingers);
    }
    return record(chosen.array(), quality.array(), regions.array());
}

void check_width(double width) {
    if (!(width > 0 && std::isfinite(width))) throw std::invalid_argument("width must be above 0, not " + number(width));
}

void check_closure(std::size_t count, std::size_t normals, double rho, double friction) {
    if (count < 2 || count > max_contacts || normals != count)
        throw std::invalid_argument("force closure takes 2 to 8 contacts, each with its normal, not " + std::to_string(count));
    if (!(rho > 0 && friction >= 0))
        throw std::invalid_argument("rho must be above 0 and friction at least 0, not " + number(rho) + " and " + number(friction));
}

}  // namespace

void bind_grasp(nb::module_ &m) {
    m.def("contact_frames", [](const PointArray &points, const IndexArray &offsets, const RowArray &places, double width) {
        check_width(width);
        const Outline outline = outline_of(points, offsets);
        const std::size_t count = count_places(places);
        Output<> out(count, 4);
        double *v = out.values();
        for (std::size_t k = 0; k < count; ++k) {
            const ContactFrame frame = contact_frame(place_of(outline, places, k), width);
            *v++ = frame.nx, *v++ = frame.ny, *v++ = frame.flatness, *v++ = frame.used;
        }
        return out.array();
    }, "points"_a, "offsets"_a, "places"_a, "width"_a);
    m.def("force_closure", [](const PointArray &contacts, const PointArray &normals, double cx, double cy, double rho,
                              double friction) {
        static const Record record("Closure");
        const std::size_t count = contacts.shape(0);
        check_closure(count, normals.shape(0), rho, friction);
        const Closure closure = force_closure(vectors(contacts), vectors(normals), count, {cx, cy}, rho, friction);
        return record(closure.epsilon, closure.friction_angle);
    }, "contacts"_a, "normals"_a, "cx"_a, "cy"_a, "rho"_a, "friction"_a);
    m.def("judge_contacts", [](const PointArray &points, const IndexArray &offsets, const PointArray &contacts, double width, double cx,
                               double cy, double rho, double friction) {
        static const Record record("JudgedContacts");
        const std::size_t count = contacts.shape(0);
        check_closure(count, count, rho, friction);
        check_width(width);
        const Outline outline = outline_of(points, offsets);
        std::array<Projected, max_contacts> at;
        project_to_contour(outline, points_of(contacts), at.data());
        Output<> normals(count, 2), flatness(count);
        nb::list distances;
        for (std::size_t k = 0; k < count; ++k) {
            const ContactFrame frame = contact_frame(find_place(outline, at[k].contour, at[k].position), width);
            normals.vectors()[k] = {frame.nx, frame.ny}, flatness.values()[k] = frame.flatness;
            distances.append(at[k].distance);
        }
        const Closure closure = force_closure(vectors(contacts), normals.vectors(), count, {cx, cy}, rho, friction);
        return record(normals.array(), flatness.array(), distances, closure.epsilon, closure.friction_angle);
    }, "points"_a, "offsets"_a, "contacts"_a, "width"_a, "cx"_a, "cy"_a, "rho"_a, "friction"_a);
    m.def("carried_angles", [](const Input<double, nb::shape<-1, 3, 3>> &maps, const PointArray &contacts, const PointArray &normals, double rho) {
        const std::size_t count = contacts.shape(0);
        if (count < 2 || count > max_contacts || normals.shape(0) != count)
            throw std::invalid_argument("force closure takes 2 to 8 contacts, each with its normal, not " + std::to_string(count));
        if (!(rho > 0)) throw std::invalid_argument("rho must be above 0, not " + number(rho));
        Output<> out(maps.shape(0));
        for (std::size_t k = 0; k < maps.shape(0); ++k) {
            std::array<CarriedNormal, max_contacts> moved;
            std::array<Vec, max_contacts> there, across, arms;
            carry_normals(maps.data() + 9 * k, points_of(contacts), vectors(normals), moved.data());
            for (std::size_t i = 0; i < count; ++i) there[i] = moved[i].at, across[i] = moved[i].normal;
            for (std::size_t i = 0; i < count; ++i) arms[i] = (1 / rho) * (there[i] - there[0]);
            out.values()[k] = friction_angle(there.data(), across.data(), arms.data(), count);
        }
        return out.array();
    }, "maps"_a, "contacts"_a, "normals"_a, "rho"_a);
    m.def("opposed_pairs", [](const PointArray &contacts, const PointArray &normals, const ValueArray &worth,
                              std::int64_t group, double friction) {
        static const Record record("StablePairs");
        const std::size_t m = contacts.shape(0);
        if (normals.shape(0) != m || worth.shape(0) != m)
            throw std::invalid_argument("each candidate needs its normal and its worth");
        check_size(m, most_paired, "candidates");
        if (group < 1 || m % static_cast<std::size_t>(group) != 0)
            throw std::invalid_argument("candidates must fill their groups");
        if (!(friction > 0 && std::isfinite(friction)))
            throw std::invalid_argument("friction must be above 0, not " + number(friction));
        const auto found = opposed_pairs(points_of(contacts), vectors(normals), worth.data(),
                                         static_cast<std::size_t>(group), friction);
        Output<std::int64_t> pairs(found.size(), 2);
        Output<> sense(found.size()), need(found.size());
        for (std::size_t i = 0; i < found.size(); ++i) {
            pairs.values()[2 * i] = found[i].first, pairs.values()[2 * i + 1] = found[i].second;
            sense.values()[i] = found[i].sense, need.values()[i] = found[i].friction;
        }
        return record(pairs.array(), sense.array(), need.array());
    }, "contacts"_a, "normals"_a, "worth"_a, "group"_a, "friction"_a);
    m.def("closing_triples", [](const PointArray &contacts, const PointArray &normals, double cx, double cy, double rho,
                                double friction) {
        static const Record record("StableTriples");
        if (normals.shape(0) != contacts.shape(0)) throw std::invalid_argument("each candidate needs its normal");
        check_size(contacts.shape(0), most_tripled, "candidates");
        if (!(rho > 0 && friction > 0 && std::isfinite(friction)))
            throw std::invalid_argument("rho and friction must be above 0, not " + number(rho) + " and " + number(friction));
        const auto found = closing_triples(points_of(contacts), vectors(normals), {cx, cy}, rho, friction);
        Output<std::int64_t> triples(found.size(), 3);
        Output<> sense(found.size()), epsilon(found.size());
        for (std::size_t i = 0; i < found.size(); ++i) {
            std::copy(found[i].index.begin(), found[i].index.end(), triples.values() + 3 * i);
            sense.values()[i] = found[i].sense, epsilon.values()[i] = found[i].epsilon;
        }
        return record(triples.array(), sense.array(), epsilon.array());
    }, "contacts"_a, "normals"_a, "cx"_a, "cy"_a, "rho"_a, "friction"_a);
    m.def("finger_clearance", [](const PointArray &points, const IndexArray &offsets, const PointArray &contacts,
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
        Output<> out(count, 2);
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
    }, "points"_a, "offsets"_a, "contacts"_a, "directions"_a, "places"_a.none(), "width"_a, "depth"_a, "reach"_a);
    m.def("rank_grasps", &rank_grasps_, "candidates"_a, "grasps"_a, "strength"_a, "bound"_a, "space"_a, "limits"_a);
}

}  // namespace grasptrack
