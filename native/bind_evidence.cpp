// SPDX-License-Identifier: Apache-2.0
// The kernels of the evidence for a pose and against it, in Python.

#include "bind_evidence.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>

#include "arrays.hpp"
#include "byte_image.hpp"
#include "flanks.hpp"
#include "fusion.hpp"
#include "weighing.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

void check_homography(const RowArray &H) {
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
}

nb::tuple py_weigh_edges(const ByteImage &image, const PointArray &points, const PointArray &normals,
                         const RowArray &edges, const FlagArray &inside, const FlagArray &found,
                         const ValueArray &reference_inside, const ValueArray &reference_outside, std::int64_t contacts,
                         int polarity, double reach, double size, const FlagArray &beside, const FlagArray &known,
                         const std::optional<ByteImage> &hidden) {
    const std::size_t m = points.shape(0), n = beside.shape(0);
    if (n == 0 || n > m || contacts < 1 || (m - n) % static_cast<std::size_t>(contacts) != 0 || known.shape(0) != n)
        throw std::invalid_argument("samples round the outline are needed, and as many under each contact");
    if (normals.shape(0) != m || edges.shape(0) != m || edges.shape(1) != 4 || inside.shape(0) != m ||
        found.shape(0) != m || reference_inside.shape(0) != m || reference_outside.shape(0) != m)
        throw std::invalid_argument("each sample needs its normal, edge, flags and levels");
    if (hidden && (hidden->shape(0) != image.shape(0) || hidden->shape(1) != image.shape(1)))
        throw std::invalid_argument("what is hidden needs the image's size");
    static_assert(sizeof(Edge) == 4 * sizeof(double));
    const Levels levels(seen(image), hidden ? hidden->data() : nullptr);
    const auto k = static_cast<std::size_t>(contacts);
    Output found_at(k);
    OutputOf<bool> against(n);
    const Weights out = weigh_edges({vectors(points), vectors(normals), reinterpret_cast<const Edge *>(edges.data()),
                                     inside.data(), found.data(), reference_inside.data(), reference_outside.data(), m,
                                     n, polarity, reach, size},
                                    levels, beside.data(), known.data(), k, found_at.values(), against.values());
    return nb::make_tuple(out.share, out.visible, out.rms, out.spread, found_at.array(), out.against,
                          nb::make_tuple(out.dark, out.light), against.array());
}

nb::tuple py_grey_differences(const ByteImage &coarse, double shrink, const RowArray &H, const PointArray &places,
                              const ValueArray &values, double least_noise) {
    const std::size_t p = places.shape(0);
    check_homography(H);
    if (values.shape(0) != p) throw std::invalid_argument("each place needs its value");
    Output out(p);
    const double noise = grey_differences(seen(coarse), shrink, H.data(), vectors(places), values.data(), p, least_noise,
                                          out.values());
    return nb::make_tuple(out.array(), noise);
}

nb::tuple py_judge_flanks(const ByteImage &coarse, double shrink, const RowArray &H, const PointArray &places,
                          const RowArray &values, double contrast, const FlagArray &against, const FlagArray &missed,
                          bool ground) {
    const std::size_t m = values.shape(0), each = values.shape(1);
    check_homography(H);
    if (each % 2 != 0 || places.shape(0) != m * each || against.shape(0) != m || missed.shape(0) != m)
        throw std::invalid_argument("each sample needs its flags, and as many places within as beyond, with their values");
    OutputOf<bool> out(m), covered(m);
    judge_flanks(seen(coarse), shrink, H.data(),
                 {vectors(places), values.data(), against.data(), missed.data(), m, each / 2, contrast, ground},
                 out.values(), covered.values());
    return nb::make_tuple(out.array(), covered.array());
}

nb::tuple py_converge(const ByteImage &image, const ByteImage &coarse, double shrink, const RowArray &H,
                      const PointArray &points, const PointArray &normals, const ValueArray &strength, int polarity,
                      double reach, double least_strength, double relative_strength, const PointArray &places,
                      const ValueArray &values, const PointArray &slopes, const IndexArray &starts, const FlagArray &use,
                      double caution, double loose, double still, int least, int most,
                      const std::optional<ByteImage> &clear) {
    const std::size_t m = points.shape(0), p = places.shape(0), count = starts.shape(0);
    check_homography(H);
    if (m == 0 || normals.shape(0) != m || strength.shape(0) != m)
        throw std::invalid_argument("samples are needed, each with its normal and strength");
    const std::int64_t *start = starts.data();
    bool good = values.shape(0) == p && slopes.shape(0) == p && count > 0 && start[0] == 0 &&
                start[count - 1] == static_cast<std::int64_t>(p);
    for (std::size_t g = 1; good && g < count; ++g) good = start[g - 1] <= start[g];
    if (!good)
        throw std::invalid_argument("each place needs its value and slope, and starts rise from 0 to the number of places");
    if (!(reach > 0 && reach <= 1000))
        throw std::invalid_argument("reach must be above 0 and at most 1000 px, not " + number(reach));
    if (use.shape(0) != count)
        throw std::invalid_argument("the outline and each surface are in use or not: " + std::to_string(count) + " flags");
    if (!(loose > 0)) throw std::invalid_argument("motions are loose by more than 0 px, not " + number(loose));
    const Clear hidden = clear_of(image, clear);
    Output found(3, 3), left(m), weight(m), basis(8, 8), N(8 * count, 8), sure(8 * count, 8), b(count, 8),
        stats(count, 4), centre(2), step(8);
    Converging run(seen(image), seen(coarse), shrink,
                   {points.data(), normals.data(), strength.data(), m, reach, {polarity, least_strength, relative_strength}},
                   {vectors(places), vectors(slopes), values.data(), start, count - 1}, hidden, left.values(), weight.values());
    run.run(H.data(), {use.data(), caution, loose, still, least, most});
    std::copy(run.H, run.H + 9, found.values());
    centre.values()[0] = run.centre.x, centre.values()[1] = run.centre.y;
    std::copy(run.step.begin(), run.step.end(), step.values());
    for (int r = 0; r < 8; ++r) std::copy(run.basis[r].begin(), run.basis[r].end(), basis.values() + 8 * r);
    for (std::size_t g = 0; g < count; ++g) {
        const Equations &row = run.rows[g];
        for (int r = 0; r < 8; ++r) {
            std::copy(row.N[r].begin(), row.N[r].end(), N.values() + 64 * g + 8 * r);
            std::copy(run.sure[g][r].begin(), run.sure[g][r].end(), sure.values() + 64 * g + 8 * r);
        }
        std::copy(row.b.begin(), row.b.end(), b.values() + 8 * g);
        const double told[4] = {row.total, row.share, row.noise, row.correlation};
        std::copy(told, told + 4, stats.values() + 4 * g);
    }
    const auto squares = nb::make_tuple(count, 8, 8);
    const nb::tuple evidence =
        nb::make_tuple(centre.array(), run.radius, basis.array(), N.array().attr("reshape")(squares),
                       sure.array().attr("reshape")(squares), b.array(), stats.array(), left.array(), weight.array());
    return nb::make_tuple(found.array(), run.moves, step.array(), run.scatter, evidence);
}

nb::tuple py_seen_motion(const RowArray &N, const ValueArray &b, double least) {
    if (N.shape(0) != 8 || N.shape(1) != 8 || b.shape(0) != 8) throw std::invalid_argument("eight motions are needed");
    Matrix8 M;
    Row8 products;
    for (int r = 0; r < 8; ++r) {
        products[r] = b.data()[r];
        for (int c = 0; c < 8; ++c) M[r][c] = N.data()[8 * r + c];
    }
    const Seen out = seen_motion(M, products, least);
    return nb::make_tuple(out.size, out.weighed);
}

nb::object py_contact_covariance(const RowArray &H, const PointArray &contacts, const ValueArray &centre, double radius,
                                 const RowArray &basis, const Input<double, 3> &sure, const ValueArray &share,
                                 double loose) {
    const std::size_t k = contacts.shape(0), rows = share.shape(0);
    check_homography(H);
    if (centre.shape(0) != 2 || basis.shape(0) != 8 || basis.shape(1) != 8 || sure.shape(0) != rows ||
        sure.shape(1) != 8 || sure.shape(2) != 8)
        throw std::invalid_argument("eight motions are needed, and of each piece of evidence its squares and share");
    Output out(2 * k, 2 * k);
    contact_covariance(H.data(), vectors(contacts), k,
                       {{centre.data()[0], centre.data()[1]}, radius, loose, basis.data(), sure.data(), share.data(), rows},
                       out.values());
    return out.array();
}

}  // namespace

void bind_evidence(nb::module_ &m) {
    m.def("weigh_edges", &py_weigh_edges, "image"_a.noconvert(), "points"_a, "normals"_a, "edges"_a, "inside"_a,
          "found"_a, "reference_inside"_a, "reference_outside"_a, "contacts"_a, "polarity"_a, "reach"_a, "size"_a,
          "beside"_a, "known"_a, "hidden"_a.none());
    m.def("grey_differences", &py_grey_differences, "coarse"_a.noconvert(), "shrink"_a, "H"_a, "places"_a, "values"_a,
          "least_noise"_a);
    m.def("judge_flanks", &py_judge_flanks, "coarse"_a.noconvert(), "shrink"_a, "H"_a, "places"_a, "values"_a,
          "contrast"_a, "against"_a, "missed"_a, "ground"_a);
    m.def("converge", &py_converge, "image"_a.noconvert(), "coarse"_a.noconvert(), "shrink"_a, "H"_a, "points"_a,
          "normals"_a, "strength"_a, "polarity"_a, "reach"_a, "least_strength"_a, "relative_strength"_a, "places"_a,
          "values"_a, "slopes"_a, "starts"_a, "use"_a, "caution"_a, "loose"_a, "still"_a, "least"_a, "most"_a,
          "clear"_a.none() = nb::none());
    m.def("seen_motion", &py_seen_motion, "N"_a, "b"_a, "least"_a);
    m.def("contact_covariance", &py_contact_covariance, "H"_a, "contacts"_a, "centre"_a, "radius"_a, "basis"_a, "sure"_a,
          "share"_a, "loose"_a);
}

}  // namespace grasptrack
