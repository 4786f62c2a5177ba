// SPDX-License-Identifier: Apache-2.0
// What was chosen in the reference view: samples of the outline, patches of texture, samples of the surface.
// All positions are in work px: the reference view cut out and, where it is large, reduced. See tracking/target.py.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "matrix.hpp"

namespace grasptrack::pose {

constexpr int patch_side = 7;
constexpr int patch_pixels = patch_side * patch_side;
constexpr int inner_pixels = 6;   // of an edge's inner side, from 7 to 2 px inside
constexpr int inner_first = -7;
constexpr int region_cells = 16;  // on each side of the outline, as deep as a notch or tab that counts as one goes
constexpr std::size_t fine_levels = 3;  // of texture, that are used beside the edges and told of; the coarser of them where blur has taken the finest

struct Patch {
    double x, y;                                   // centre
    std::array<float, patch_pixels> value, gx, gy;  // less their means; gradients per work px
    double axx, axy, ayy;                          // sums of products of the gradients
    double cosine, sine;                           // direction of the axis along which they are largest
    std::array<double, 2> power;                   // sums of their squares along it and across it
    std::array<double, 2> within;                  // the same of plain gradients, of the inner pixels
    double variance;                               // sum of squares of the values
    std::array<Vector<8>, 2> rows;                 // d(shift that it tells) / d(pose), by the places of all its pixels
};

struct PatchSet {
    double stride;  // work px between two pixels
    std::vector<Patch> patches;
};

// Where places lie beside those the pose alone has them, for a readout of 1, work px: J (b0 + b1 u + b2 v) at (u, v), taken from the
// centre in units of the radius, J being the jacobian there.
using Bend = std::array<Vector<8>, 3>;

// The same of what tells a shift by rows J: a place, or a patch, whose rows have the u and v of its pixels, as far as they tell, in them.
inline Point bent(const Bend &bend, const std::array<Vector<8>, 2> &J) {
    std::array<Point, 3> by{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 8; ++k) {
            by[i].x += J[0][k] * bend[i][k];
            by[i].y += J[1][k] * bend[i][k];
        }
    const auto along = [&](const Vector<8> &row) {
        return row[2] * by[1].x + row[4] * by[1].y + row[3] * by[2].x + row[5] * by[2].y;
    };
    return {by[0].x + along(J[0]), by[0].y + along(J[1])};
}

// Of the reference image, which may have been cut out of another: its width, and where its middle lies, px.
struct Taught {
    double width, x, y;
};

struct Target {
    Homography A;              // work px -> reference image
    double cx, cy, radius;     // normalised coordinates: (x - cx) / radius
    double noise;              // grey levels, of the camera
    double half;               // work px on each side of an edge that were averaged for `contrast`
    std::vector<Point> points, normals;  // outline samples and their outward normals
    std::vector<double> contrast;        // signed step, grey levels, at each
    std::vector<double> inner;           // (n, inner_pixels) grey levels inside each
    std::vector<Vector<8>> rows;         // d(offset along the normal) / d(pose)
    std::vector<Packed<8>> squares;      // of each row with itself
    std::vector<Packed<8>> along;        // the same of what moves a sample along the outline, times rad^2 by which noise may turn its normal
    std::vector<double> depth;           // (region_cells) work px from the outline
    std::vector<double> inside;          // (n, region_cells) grey levels at these depths inside; NaN where that is no material
    std::vector<double> outside;         // (n, region_cells) 1 where that depth outside is outside, else 0
    std::vector<PatchSet> texture;       // fine to coarse
    std::vector<Point> surface;          // where the surface's gain and bias are measured
    std::vector<double> surface_value;
    std::vector<Point> contacts;
    std::optional<Taught> taught;        // none: the images that are looked at are as the reference image

    // Derivatives of a point's place by the pose's error d: two rows of 8.
    std::array<Vector<8>, 2> jacobian(double x, double y) const {
        const double u = (x - cx) / radius, v = (y - cy) / radius;
        return {Vector<8>{1, 0, u, v, 0, 0, u * u, u * v}, Vector<8>{0, 1, 0, 0, u, v, u * v, v * v}};
    }

    // G exp(d): the pose moved by an error of d work px at the half size.
    Homography moved(const Homography &G, const Vector<8> &d) const {
        const double r = radius;
        const double a = 1 + d[2] / r, b = d[3] / r, c = d[4] / r, e = 1 + d[5] / r;
        const double tx = d[0] / r, ty = d[1] / r, g = -d[6] / r, h = -d[7] / r;
        // T^-1 D T, with T = [[1/r, 0, -cx/r], [0, 1/r, -cy/r], [0, 0, 1]]
        const Homography T{1 / r, 0, -cx / r, 0, 1 / r, -cy / r, 0, 0, 1}, back{r, 0, cx, 0, r, cy, 0, 0, 1};
        const Homography D{a, b, tx, c, e, ty, g, h, 1};
        Homography out = times<3>(times<3>(G, back), times<3>(D, T));
        const double s = 1.0 / out[8];
        for (double &value : out) value *= s;
        return out;
    }

    // The d with moved(G0, d) = G, false where there is none.
    bool difference(const Homography &G0, const Homography &G, Vector<8> &d) const {
        Homography inverse;
        if (!invert_homography(G0, inverse)) return false;
        const double r = radius;
        const Homography T{1 / r, 0, -cx / r, 0, 1 / r, -cy / r, 0, 0, 1}, back{r, 0, cx, 0, r, cy, 0, 0, 1};
        const Homography D = times<3>(times<3>(T, times<3>(inverse, G)), back);
        if (!(std::abs(D[8]) > 1e-12)) return false;
        const double s = 1.0 / D[8];
        d = {r * D[2] * s, r * D[5] * s, r * (D[0] * s - 1), r * D[1] * s,
             r * D[3] * s, r * (D[4] * s - 1), -r * D[6] * s, -r * D[7] * s};
        for (double value : d)
            if (!std::isfinite(value)) return false;
        return true;
    }
};

}  // namespace grasptrack::pose
