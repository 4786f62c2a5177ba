// SPDX-License-Identifier: Apache-2.0
// The pose estimator in Python: a target made once, then a solution for each hypothesis of each image.

#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>

#include "../arrays.hpp"
#include "estimate.hpp"
#include "plane.hpp"
#include "repeats.hpp"
#include "solver.hpp"
#include "telling.hpp"
#include "texture.hpp"

namespace grasptrack {

namespace {

using Doubles = Input<double>;
using Bytes = ByteImage;
// Of grasptrack.kernels.results.PlaneViews.
using SeenViews = std::tuple<Doubles, Doubles, Doubles, double, double, double, Doubles, Doubles, double>;

std::size_t count(const Doubles &array) {
    std::size_t size = 1;
    for (std::size_t i = 0; i < array.ndim(); ++i) size *= array.shape(i);
    return size;
}

template <std::size_t N> std::array<double, N> fixed(const Doubles &array, const char *name) {
    if (count(array) != N) throw std::invalid_argument(std::string(name) + " needs " + std::to_string(N) + " numbers");
    std::array<double, N> out{};
    std::copy(array.data(), array.data() + N, out.begin());
    return out;
}

pose::Bend bend_of(const Doubles &array) {
    const auto flat = fixed<24>(array, "the bend");
    pose::Bend out{};
    for (std::size_t k = 0; k < flat.size(); ++k) out[k / 8][k % 8] = flat[k];
    return out;
}

std::vector<double> values(const Doubles &array) { return {array.data(), array.data() + count(array)}; }

std::vector<pose::Point> places(const Doubles &array, const char *name) {
    if (array.ndim() != 2 || array.shape(1) != 2) throw std::invalid_argument(std::string(name) + " are of shape (N, 2)");
    std::vector<pose::Point> out(array.shape(0));
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = {array.data()[2 * i], array.data()[2 * i + 1]};
    return out;
}

pose::Pyramid pyramid_of(const std::vector<Bytes> &levels) {
    if (levels.empty()) throw std::invalid_argument("a pyramid has at least one level");
    pose::Pyramid out;
    for (const Bytes &level : levels) check_size(level.size(), (std::size_t{1} << 31) - 1, "pixels");
    for (const Bytes &level : levels)
        out.push_back({level.data(), static_cast<std::ptrdiff_t>(level.shape(0)), static_cast<std::ptrdiff_t>(level.shape(1))});
    return out;
}

pose::PatchSet cut_patches(const pose::Target &target, const pose::Pyramid &pyramid, const pose::Homography &G,
                           const std::vector<pose::Point> &centres, double stride) {
    if (!(stride > 0) || !std::isfinite(stride)) throw std::invalid_argument("the stride is above 0");
    pose::PatchSet set{stride, {}};
    for (const pose::Point &c : centres) {
        pose::Patch patch;
        if (pose::cut_patch(target, pyramid, G, c.x, c.y, stride, patch)) set.patches.push_back(patch);
    }
    return set;
}

pose::Numbers numbers_of(const nb::dict &given) {
    const auto number = [&given](const char *name) {
        if (!given.contains(name)) throw std::invalid_argument(std::string("the number ") + name + " is missing");
        double value = 0;
        if (!nb::try_cast(given[name], value)) throw std::invalid_argument(std::string("the number ") + name + " is none");
        return value;
    };
    pose::Numbers n{};
    for (const auto &[name, member] : pose::number_names) n.*member = number(name);
    return n;
}

nb::object places_of(const pose::Contacts &at) { return copied(at.places.data(), at.places.size() / 2, 2); }
nb::object covariances_of(const pose::Contacts &at) { return copied(at.covariances.data(), at.places.size() / 2, 2, 2); }

// A solution with what else Python knows of it.
struct PoseEstimate : pose::Solution {
    pose::Bend bend{};
    pose::Contacts contacts;
    double hidden = 0, area = 0;
    std::string origin;
    bool confirmed = false;
    double slipped = 0;
};

// A member that Python reads as an array of this shape; of a vector without one.
template <typename Bound, typename Class, typename Values, typename... Shape> auto array_of(Values Class::*member, Shape... shape) {
    return [=](const Bound &from) {
        if constexpr (sizeof...(Shape) > 0) return copied((from.*member).data(), shape...);
        else return copied(from.*member);
    };
}

// Pixels of an image.
pose::Frame frame_of(double width, double height, double aspect) {
    if (!(aspect > 0) || !std::isfinite(aspect)) throw std::invalid_argument("the pixels' aspect is above 0");
    return {width, height, aspect};
}

// Variances of a pose's error.
pose::Vector<8> variances_of(const Doubles &given) {
    const auto out = fixed<8>(given, "lag");
    for (double value : out)
        if (!(value >= 0)) throw std::invalid_argument("the variances of a lag are 0 or more");
    return out;
}

// What Python calls PoseTarget: the target, and the numbers that it is looked at with.
struct PoseTarget {
    pose::Target target;
    pose::Numbers numbers;
    struct Mask {
        std::vector<std::uint8_t> data;
        std::ptrdiff_t height, width;
    };
    std::vector<Mask> hidden;

    PoseTarget(const nb::dict &given, const Doubles &A, const Doubles &centre, double radius, double noise, double half,
               const Doubles &normal_noise, const Doubles &points, const Doubles &normals, const Doubles &contrast, const Doubles &inner, const Doubles &surface,
               const Doubles &surface_value, const Doubles &contacts, const Doubles &depth, const Doubles &inside,
               const Doubles &outside)
        : numbers(numbers_of(given)) {
        if (!(radius > 0) || !std::isfinite(radius)) throw std::invalid_argument("the radius is above 0");
        target.A = fixed<9>(A, "A");
        const auto c = fixed<2>(centre, "the centre");
        target.cx = c[0];
        target.cy = c[1];
        target.radius = radius;
        target.noise = noise;
        target.half = half;
        target.points = places(points, "points");
        target.normals = places(normals, "normals");
        target.contrast = values(contrast);
        target.inner = values(inner);
        target.surface = places(surface, "surface samples");
        target.surface_value = values(surface_value);
        target.contacts = places(contacts, "contacts");
        target.depth = values(depth);
        target.inside = values(inside);
        target.outside = values(outside);
        const std::size_t n = target.points.size();
        const std::vector<double> turned = values(normal_noise);
        if (turned.size() != n || target.normals.size() != n || target.contrast.size() != n || target.inner.size() != n * pose::inner_pixels ||
            target.surface_value.size() != target.surface.size() || target.depth.size() != pose::region_cells ||
            target.inside.size() != n * pose::region_cells || target.outside.size() != n * pose::region_cells)
            throw std::invalid_argument("points, normals, contrasts and inner sides need the same length");
        for (std::size_t i = 0; i < n; ++i) {
            const auto J = target.jacobian(target.points[i].x, target.points[i].y);
            pose::Vector<8> row, tangent;
            for (std::size_t k = 0; k < 8; ++k) {
                row[k] = target.normals[i].x * J[0][k] + target.normals[i].y * J[1][k];
                tangent[k] = turned[i] * (target.normals[i].x * J[1][k] - target.normals[i].y * J[0][k]);
            }
            target.rows.push_back(row);
            target.squares.push_back(pose::outer<8>(row));
            target.along.push_back(pose::outer<8>(tangent));
        }
    }

    // Pixels of every image, level by level, that show nothing of the scene: nonzero.
    void hide(const std::vector<Bytes> &levels) {
        hidden.clear();
        for (const Bytes &level : levels)
            hidden.push_back({{level.data(), level.data() + level.size()},
                              static_cast<std::ptrdiff_t>(level.shape(0)), static_cast<std::ptrdiff_t>(level.shape(1))});
    }

    void taught_by(double width, double x, double y) {
        if (!(width > 0) || !std::isfinite(width + x + y)) throw std::invalid_argument("the width is above 0");
        target.taught = {width, x, y};
    }

    pose::Pyramid seen(const std::vector<Bytes> &levels) const {
        pose::Pyramid out = pyramid_of(levels);
        for (std::size_t k = 0; k < std::min(out.size(), hidden.size()); ++k) {
            if (hidden[k].height != out[k].height || hidden[k].width != out[k].width)
                throw std::invalid_argument("images and the mask of what is hidden need the same size");
            out[k].hidden = hidden[k].data.data();
        }
        return out;
    }

    // Patches of the reference image, fine to coarse in the order of calls; how many were whole in view.
    std::size_t add_texture(const std::vector<Bytes> &levels, const Doubles &centres, double stride) {
        target.texture.push_back(cut_patches(target, seen(levels), target.A, places(centres, "centres"), stride));
        return target.texture.back().patches.size();
    }

    PoseEstimate solve(const std::vector<Bytes> &levels, const Doubles &G, const Doubles &P, const Doubles &last, const Doubles &bend,
                       double readout, double readout_variance, const Doubles &nuisance, const Doubles &nuisance_covariance, double sides,
                       double inner_spread, double gain, double bias, double reach, double edge_width, double blur_share,
                       const Doubles &lag, double aspect) const {
        const pose::Pyramid pyramid = seen(levels);
        const pose::Start start{fixed<9>(G, "G"), fixed<64>(P, "P"), fixed<9>(last, "last"), bend_of(bend), readout,
                                fixed<4>(nuisance, "nuisance"), fixed<16>(nuisance_covariance, "nuisance_covariance"), sides, inner_spread,
                                reach, edge_width, blur_share, {gain, bias}, frame_of(static_cast<double>(pyramid[0].width), static_cast<double>(pyramid[0].height), aspect),
                                variances_of(lag)};
        nb::gil_scoped_release free;
        PoseEstimate out;
        static_cast<pose::Solution &>(out) = pose::Solver(target, pyramid, start, numbers).solve();
        for (std::size_t i = 0; i < 8; ++i)
            for (std::size_t j = 0; j < 8; ++j) out.P[i * 8 + j] += out.by_readout[i] * (out.by_readout[j] * readout_variance);
        out.bend = start.bend;
        out.contacts = pose::placed_contacts(target, out.G, out.P);
        return out;
    }

    // The same estimate, known otherwise.
    PoseEstimate known_by(const PoseEstimate &estimate, const Doubles &P, const Doubles &beforehand) const {
        PoseEstimate out = estimate;
        out.P = fixed<64>(P, "P");
        out.beforehand = fixed<64>(beforehand, "beforehand");
        out.contacts = pose::placed_contacts(target, out.G, out.P);
        return out;
    }

    // How much patches would have changed since the last image, seen through `last`, and how far those moved that did not.
    nb::object repeats(const std::vector<Bytes> &before, const Doubles &last, const std::vector<Bytes> &levels, const Doubles &G) const {
        const pose::Pyramid old = seen(before), now = seen(levels);
        const bool alike = std::equal(old.begin(), old.end(), now.begin(), now.end(), [](const pose::Level &a, const pose::Level &b) {
            return a.height == b.height && a.width == b.width;
        });
        if (!alike) throw std::invalid_argument("both pyramids need the same size");
        const pose::Repeats found = pose::count_repeats(target, old, fixed<9>(last, "last"), now, fixed<9>(G, "G"));
        static const Record record("RepeatedPatches");
        return record(found.change, found.way);
    }

    // The last image's look at `centres` through `last`, laid on the next image from a start.
    pose::FlowFit follow(const std::vector<Bytes> &before, const Doubles &last, const std::vector<Bytes> &levels, const Doubles &start,
                         const Doubles &P, const Doubles &centres, const Doubles &strides) const {
        const pose::Pyramid old = seen(before), now = seen(levels);
        const pose::Homography from = fixed<9>(last, "last"), to = fixed<9>(start, "start");
        const pose::Matrix<8> prior = fixed<64>(P, "P");
        std::vector<pose::Point> at = places(centres, "centres");
        nb::gil_scoped_release free;
        std::vector<pose::PatchSet> looks;
        for (double stride : values(strides)) {
            looks.push_back(cut_patches(target, old, from, at, stride));
            at.resize(std::min(at.size(), std::max(pose::fewest_places, at.size() / 2)));
        }
        return pose::follow_look(target, looks, now, to, prior, target.noise,
                                 {numbers.texture_floor, numbers.texture_independent, numbers.texture_freedom});
    }

    nb::object moved(const Doubles &G, const Doubles &d) const {
        const auto out = target.moved(fixed<9>(G, "G"), fixed<8>(d, "d"));
        return copied(out.data(), 3, 3);
    }

    // (8,) the error that leads from one pose to another; NaN where none does.
    nb::object difference(const Doubles &from, const Doubles &to) const {
        pose::Vector<8> d;
        if (!target.difference(fixed<9>(from, "the first pose"), fixed<9>(to, "the second pose"), d))
            d.fill(std::numeric_limits<double>::quiet_NaN());
        return copied(d.data(), 8);
    }

    nb::object placed(const Doubles &G, const Doubles &P) const {
        const pose::Contacts at = pose::placed_contacts(target, fixed<9>(G, "G"), fixed<64>(P, "P"));
        static const Record record("PlacedContacts");
        return record(places_of(at), covariances_of(at), nb::make_tuple(at.middle.x, at.middle.y));
    }

    nb::object joined(const Doubles &G, const Doubles &P, const Doubles &other, const Doubles &Q) const {
        const pose::Joined out = pose::joined(target, fixed<9>(G, "the first pose"), fixed<64>(P, "the first covariance"),
                                              fixed<9>(other, "the second pose"), fixed<64>(Q, "the second covariance"));
        static const Record record("FusedPose");
        return record(out.distance, copied(out.G.data(), 3, 3), copied(out.P.data(), 8, 8));
    }

    pose::PlaneViews plane_views(const SeenViews &views) const {
        const auto &[poses, covariances, hull, width, height, aspect, theta, scale, freedom] = views;
        const std::size_t n = count(poses) / 9;
        if (count(poses) != 9 * n || count(covariances) != 64 * n) throw std::invalid_argument("each pose (3, 3) needs its covariance (8, 8)");
        pose::PlaneViews out(target, numbers, frame_of(width, height, aspect), places(hull, "corners of the hull"),
                             {fixed<3>(theta, "theta"), fixed<9>(scale, "the scale"), freedom});
        for (std::size_t k = 0; k < n; ++k) {
            pose::Homography G;
            pose::Matrix<8> P;
            std::copy_n(poses.data() + 9 * k, 9, G.begin());
            std::copy_n(covariances.data() + 64 * k, 64, P.begin());
            out.add(G, P);
        }
        return out;
    }

    nb::object plane_cost(const SeenViews &views, const Doubles &theta) const {
        const auto found = plane_views(views).equations(fixed<3>(theta, "theta"));
        return nb::make_tuple(found.cost, copied(found.A.data(), 3, 3), copied(found.b.data(), 3));
    }

    nb::object plane_modes(const SeenViews &views, const Doubles &starts) const {
        const pose::PlaneViews seen = plane_views(views);
        std::vector<pose::Theta> from(count(starts) / 3);
        for (std::size_t k = 0; k < 3 * from.size(); ++k) from[k / 3][k % 3] = starts.data()[k];
        nb::list out;
        for (const pose::Mode &mode : seen.modes(from))
            out.append(nb::make_tuple(copied(mode.theta.data(), 3), copied(mode.covariance.data(), 3, 3), mode.probability));
        return out;
    }

    nb::object open_tilts(const SeenViews &views, const Doubles &starts, const Doubles &nodes) const {
        std::vector<pose::Slopes> from;
        for (const pose::Point &p : places(starts, "starts")) from.push_back({p.x, p.y});
        std::vector<double> thetas, weights;
        for (const pose::OpenTilt &each : plane_views(views).open_tilts(from, places(nodes, "nodes"))) {
            thetas.insert(thetas.end(), each.theta.begin(), each.theta.end());
            weights.push_back(each.weight);
        }
        return nb::make_tuple(copied(thetas.data(), weights.size(), 3), copied(weights));
    }

    double pixel_aspect(const SeenViews &views, const Doubles &theta) const {
        return plane_views(views).pixel_aspect(fixed<3>(theta, "theta"));
    }
};

// Positions and signed steps of the strongest candidates: what the target is made from.
nb::object strongest_edges(const std::vector<Bytes> &levels, const Doubles &A, const Doubles &points, const Doubles &normals,
                          double noise, std::int64_t asked_reach, std::int64_t asked_half) {
    const pose::Pyramid pyramid = pyramid_of(levels);
    pose::Target target{};
    target.A = fixed<9>(A, "A");
    target.points = places(points, "points");
    target.normals = places(normals, "normals");
    const std::size_t n = target.points.size();
    if (target.normals.size() != n) throw std::invalid_argument("each point needs its normal");
    check_within(static_cast<double>(asked_reach), 0, pose::farthest, "reach");
    check_within(static_cast<double>(asked_half), pose::least_half, pose::most_half, "half a width");
    const int reach = static_cast<int>(asked_reach), half = static_cast<int>(asked_half);
    target.noise = noise;
    target.inner.assign(n * pose::inner_pixels, 0.0);
    double cx = 0, cy = 0;
    for (const auto &p : target.points) cx += p.x / static_cast<double>(n), cy += p.y / static_cast<double>(n);
    target.cx = cx;
    target.cy = cy;
    const pose::Seen seen = pose::look_through(pyramid, target.A, {cx, cy});
    std::vector<double> offset(n, std::numeric_limits<double>::quiet_NaN()), step(n, 0.0), inner(n * pose::inner_pixels), width = offset;
    const int span = reach + 2 * pose::most_half;
    std::vector<double> line(static_cast<std::size_t>(2 * span + 1));
    for (std::size_t i = 0; i < n; ++i) {
        pose::EdgeSample s;
        if (!pose::profile(seen, target.points[i], target.normals[i], span, {-span, span}, line.data())) continue;
        pose::find_candidates(line.data(), span, reach, noise, half, s);
        double best = 0;
        for (std::size_t c = 0; c < static_cast<std::size_t>(s.count); ++c) {
            const double score = std::abs(s.step[c]) * std::exp(-s.offset[c] * s.offset[c] / (2 * half * half));
            if (std::abs(s.offset[c]) < half + 1.5 && score > best) best = score, offset[i] = s.offset[c], step[i] = s.step[c];
        }
        width[i] = pose::edge_width(line.data(), span, half);
        for (int k = 0; k < pose::inner_pixels; ++k)
            inner[i * pose::inner_pixels + static_cast<std::size_t>(k)] = line[static_cast<std::size_t>(span + pose::inner_first - (half - pose::least_half) + k)];
    }
    static const Record record("StrongestEdges");
    return record(copied(offset), copied(step), copied(inner.data(), n, pose::inner_pixels), copied(width));
}

double seen_area(const Doubles &G, const Doubles &points) {
    if (points.ndim() != 2 || points.shape(1) != 2) throw std::invalid_argument("points are of shape (N, 2)");
    return pose::seen_area(fixed<9>(G, "G"), points.data(), points.shape(0));
}

void check_usual(const std::vector<Doubles> &correlation, const std::vector<Doubles> &usual) {
    bool alike = usual.size() == correlation.size();
    for (std::size_t k = 0; alike && k < usual.size(); ++k) alike = count(usual[k]) == count(correlation[k]);
    if (!alike) throw std::invalid_argument("each correlation needs what is usual");
}

nb::list surface_probability(const std::vector<Doubles> &correlation, const std::vector<Doubles> &usual, double match_spread, double chance_spread) {
    check_usual(correlation, usual);
    nb::list levels;
    for (std::size_t k = 0; k < usual.size(); ++k) {
        Output<> out(count(usual[k]));
        pose::surface_probability(correlation[k].data(), usual[k].data(), count(usual[k]), match_spread, chance_spread, out.values());
        levels.append(out.array());
    }
    return levels;
}

nb::object surface_evidence(const std::vector<Doubles> &correlation, const std::vector<Doubles> &usual, const Doubles &shares,
                           const Doubles &log_prior, double match_spread, double chance_spread, double independent) {
    if (count(log_prior) != count(shares)) throw std::invalid_argument("each share needs its prior");
    check_usual(correlation, usual);
    pose::SurfaceEvidence out{0.0, std::vector<double>(count(shares), 0.0)};
    for (std::size_t k = 0; k < usual.size(); ++k)
        pose::add_level(out, correlation[k].data(), usual[k].data(), count(usual[k]), shares.data(), log_prior.data(), count(shares),
                        {match_spread, chance_spread, independent});
    static const Record record("SurfaceEvidence");
    return record(out.odds, copied(out.by_share));
}

}  // namespace

void bind_registration(nb::module_ &m) {
    nb::class_<PoseTarget>(m, "PoseTarget")
        .def(nb::init<const nb::dict &, const Doubles &, const Doubles &, double, double, double, const Doubles &, const Doubles &, const Doubles &,
                      const Doubles &, const Doubles &, const Doubles &, const Doubles &, const Doubles &, const Doubles &, const Doubles &,
                      const Doubles &>(),
             "numbers"_a, "A"_a, "centre"_a, "radius"_a, "noise"_a, "half"_a, "normal_noise"_a, "points"_a, "normals"_a, "contrast"_a, "inner"_a,
             "surface"_a, "surface_value"_a, "contacts"_a, "depth"_a, "inside"_a, "outside"_a)
        .def("taught_by", &PoseTarget::taught_by, "width"_a, "x"_a, "y"_a)
        .def("hide", &PoseTarget::hide, "levels"_a)
        .def("add_texture", &PoseTarget::add_texture, "levels"_a, "centres"_a, "stride"_a)
        .def("solve", &PoseTarget::solve, "levels"_a, "G"_a, "P"_a, "last"_a, "bend"_a, "readout"_a, "readout_variance"_a, "nuisance"_a, "nuisance_covariance"_a,
             "sides"_a, "inner_spread"_a, "gain"_a, "bias"_a, "reach"_a, "edge_width"_a, "blur_share"_a, "lag"_a, "aspect"_a)
        .def("repeats", &PoseTarget::repeats, "before"_a, "last"_a, "levels"_a, "G"_a)
        .def("follow", &PoseTarget::follow, "before"_a, "last"_a, "levels"_a, "start"_a, "P"_a, "centres"_a, "strides"_a)
        .def("moved", &PoseTarget::moved, "G"_a, "d"_a)
        .def("difference", &PoseTarget::difference, "first"_a, "second"_a)
        .def("known_by", &PoseTarget::known_by, "estimate"_a, "P"_a, "beforehand"_a)
        .def("placed", &PoseTarget::placed, "G"_a, "P"_a)
        .def("joined", &PoseTarget::joined, "G"_a, "P"_a, "other"_a, "Q"_a)
        .def("plane_cost", &PoseTarget::plane_cost, "views"_a, "theta"_a)
        .def("plane_modes", &PoseTarget::plane_modes, "views"_a, "starts"_a)
        .def("open_tilts", &PoseTarget::open_tilts, "views"_a, "starts"_a, "nodes"_a)
        .def("pixel_aspect", &PoseTarget::pixel_aspect, "views"_a, "theta"_a);
    using Solved = pose::Solution;
    nb::class_<pose::OtherPiece>(m, "OtherPiece")
        .def_ro("log_odds", &pose::OtherPiece::log_odds)
        .def_prop_ro("samples", array_of<pose::OtherPiece>(&pose::OtherPiece::samples));
    nb::class_<PoseEstimate>(m, "PoseEstimate")
        .def_ro("valid", &Solved::valid)
        .def_prop_ro("G", array_of<PoseEstimate>(&Solved::G, 3, 3))
        .def_prop_ro("P", array_of<PoseEstimate>(&Solved::P, 8, 8))
        .def_prop_ro("beforehand", array_of<PoseEstimate>(&Solved::beforehand, 8, 8))
        .def_prop_ro("contacts", [](const PoseEstimate &e) { return places_of(e.contacts); })
        .def_prop_ro("covariance", [](const PoseEstimate &e) { return covariances_of(e.contacts); })
        .def_prop_ro("middle", [](const PoseEstimate &e) { return nb::make_tuple(e.contacts.middle.x, e.contacts.middle.y); })
        .def_prop_ro("nuisance", array_of<PoseEstimate>(&Solved::nuisance, 4))
        .def_prop_ro("nuisance_covariance", array_of<PoseEstimate>(&Solved::nuisance_covariance, 4, 4))
        .def_ro("readout", &Solved::readout)
        .def_ro("readout_variance", &Solved::readout_variance)
        .def_prop_ro("by_readout", array_of<PoseEstimate>(&Solved::by_readout, 8))
        .def_prop_ro("bend", [](const PoseEstimate &e) { return copied(e.bend[0].data(), 3, 8); })
        .def_ro("sides", &Solved::sides)
        .def_prop_ro("light", [](const PoseEstimate &e) { return nb::make_tuple(e.light.gain, e.light.bias); })
        .def_ro("edge_width", &Solved::edge_width)
        .def_ro("blur_share", &Solved::blur_share)
        .def_ro("blur", &Solved::blur)
        .def_ro("edge_share", &Solved::edge_share)
        .def_ro("edge_sigma", &Solved::edge_sigma)
        .def_ro("look", &Solved::look)
        .def_ro("texture_agreeing", &Solved::texture_agreeing)
        .def_prop_ro("correlation", [](const PoseEstimate &e) {
            nb::list out;
            for (const auto &level : e.correlation) out.append(copied(level));
            return out;
        })
        .def_prop_ro("visible", array_of<PoseEstimate>(&Solved::visible))
        .def_prop_ro("occluded", array_of<PoseEstimate>(&Solved::occluded))
        .def_prop_ro("other", array_of<PoseEstimate>(&Solved::other))
        .def_ro("log_odds", &Solved::log_odds)
        .def_ro("elsewhere", &Solved::elsewhere)
        .def_ro("astray", &Solved::astray)
        .def_rw("other_shape", &Solved::other_shape)
        .def_prop_ro("closed_piece", [](const PoseEstimate &e) { return e.pieces.closed; })
        .def_prop_ro("open_piece", [](const PoseEstimate &e) { return e.pieces.open; })
        .def_prop_ro("covered", [](const PoseEstimate &e) { return e.hidden + e.elsewhere; })
        .def_rw("hidden", &PoseEstimate::hidden)
        .def_rw("area", &PoseEstimate::area)
        .def_rw("origin", &PoseEstimate::origin)
        .def_rw("confirmed", &PoseEstimate::confirmed)
        .def_rw("slipped", &PoseEstimate::slipped)
        .def("__copy__", [](const PoseEstimate &e) { return e; });
    nb::class_<pose::FlowFit>(m, "PoseFlow")
        .def_ro("valid", &pose::FlowFit::valid)
        .def_prop_ro("G", array_of<pose::FlowFit>(&pose::FlowFit::G, 3, 3))
        .def_prop_ro("P", array_of<pose::FlowFit>(&pose::FlowFit::covariance, 8, 8))
        .def_ro("agreeing", &pose::FlowFit::agreeing)
        .def_ro("correlation", &pose::FlowFit::correlation)
        .def_ro("used", &pose::FlowFit::used);
    nb::list names;
    for (const auto &[name, member] : pose::number_names) names.append(name);
    m.attr("POSE_NUMBERS") = nb::tuple(names);
    m.attr("PATCH_SIDE") = pose::patch_side;
    m.attr("FINE_LEVELS") = pose::fine_levels;
    m.attr("REGION_CELLS") = pose::region_cells;
    m.attr("FIRST_CELLS") = pose::first_cells;
    m.attr("NEAR_SAMPLES") = pose::near_samples;
    m.attr("LEAST_SPREAD") = pose::least_spread;
    m.attr("LEAST_HALF_WIDTH") = pose::least_half;
    m.attr("MOST_HALF_WIDTH") = pose::most_half;
    m.def("patch_noise", &pose::noise_of, "camera"_a, "stride"_a);
    m.def("seen_area", &seen_area, "G"_a, "points"_a);
    m.def("surface_evidence", &surface_evidence, "correlation"_a, "usual"_a, "shares"_a, "log_prior"_a, "match_spread"_a,
          "chance_spread"_a, "independent"_a);
    m.def("surface_probability", &surface_probability, "correlation"_a, "usual"_a, "match_spread"_a, "chance_spread"_a);
    m.def("strongest_edges", &strongest_edges, "levels"_a, "A"_a, "points"_a, "normals"_a, "noise"_a, "reach"_a, "half"_a);
}

}  // namespace grasptrack
