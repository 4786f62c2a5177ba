// SPDX-License-Identifier: Apache-2.0
// What an image says of a small motion, along an outline and on surfaces, and the pose that it asks for. Defined in
// kernels/reference_fusion.py and kernels/reference_converging.py.
#pragma once

#include "outline.hpp"
#include "surface.hpp"

namespace grasptrack {

// What is left of `told` without what chance could give: of motions that only chance shows nothing.
inline Matrix8 without_chance(const Matrix8 &told, const Matrix8 &chance) {
    Matrix8 S, V, L, out{};
    for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c) S[r][c] = told[r][c] - chance[r][c];
    if (cholesky(S, 0.0, 8, L)) return S;  // every motion shows more
    const Row8 left = eigen(S, V);
    for (int e = 0; e < 8; ++e)
        if (left[e] > 0.0)
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) out[r][c] += V[r][e] * left[e] * V[c][e];
    return out;
}

// The same where chance is alike in all motions; and how much of the products b is left.
inline Matrix8 without_chance(const Matrix8 &told, double chance, const Row8 &b, Row8 &seen) {
    Matrix8 S = told, V, L, out{};
    for (int i = 0; i < 8; ++i) S[i][i] -= chance;
    seen = {};
    if (cholesky(S, 0.0, 8, L) && cholesky(told, 0.0, 8, L)) {
        const Row8 y = backward(L, forward(L, b, 8), 8);
        for (int r = 0; r < 8; ++r)
            for (int c = 0; c < 8; ++c) seen[r] += S[r][c] * y[c];
        return S;
    }
    const Row8 left = eigen(S, V);
    for (int e = 0; e < 8; ++e) {
        if (!(left[e] > 0.0)) continue;
        double along = 0.0;
        for (int r = 0; r < 8; ++r) along += V[r][e] * b[r];
        along *= left[e] / (left[e] + chance);
        for (int r = 0; r < 8; ++r) {
            seen[r] += V[r][e] * along;
            for (int c = 0; c < 8; ++c) out[r][c] += V[r][e] * left[e] * V[c][e];
        }
    }
    return out;
}

struct OutlineSamplesIn {
    const double *points, *normals, *strength;
    std::size_t count;
    double reach;
    RegisterRules rules;
};

struct SurfacesIn {
    const Vec *places, *slopes;
    const double *values;
    const std::int64_t *starts;
    std::size_t count;  // of surfaces
};

struct Stepping {
    const bool *use;  // of the outline and of each surface
    double caution, loose, still;
    int least, most;
};

// Looks at an image under one pose after another. Room is kept from look to look.
class Converging {
  public:
    Converging(const Image<std::uint8_t> &image, const Image<std::uint8_t> &coarse, double shrink,
               const OutlineSamplesIn &outline, const SurfacesIn &surfaces, const Clear &clear, double *left,
               double *weight)
        : rows(1 + surfaces.count), sure(1 + surfaces.count), image_(image), clear_(clear), outline_(outline),
          surfaces_(surfaces),
          left_(left), weight_(weight), moved_(5 * outline.count), at_(outline.count), along_(outline.count),
          edges_(outline.count), gains_(outline.count), size_(outline.count), found_(outline.count),
          fit_(coarse, shrink, clear, most(surfaces)) {}

    double H[9];
    Vec centre;
    double radius;
    Matrix8 basis;
    std::vector<Equations> rows;
    std::vector<Matrix8> sure;
    Row8 step;
    int moves = 0;
    double scatter;

    // Step by step to where the pose stands still; false where H sends the outline to infinity.
    bool run(const double *begin, const Stepping &rules) {
        std::copy(begin, begin + 9, H);
        while (true) {
            if (!look()) return clear();
            asked(rules);
            double square = 0.0;
            for (const double value : step) square += value * value;
            if (moves >= rules.most || (moves >= rules.least && std::sqrt(square) < rules.still)) break;
            Row8 x{};
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) x[r] += basis[r][c] * step[c];
            for (double &value : x) value /= radius;
            if (!move(H, x, centre, radius)) return clear();
            ++moves;
        }
        scatter = scattered();
        for (std::size_t g = 0; g < rows.size(); ++g)
            sure[g] = g == 0 ? rows[0].N : rows[g].noise > 0.0 ? without_chance(rows[g].told, rows[g].chance) : Matrix8{};
        return true;
    }

  private:
    static std::size_t most(const SurfacesIn &surfaces) {
        std::int64_t out = 0;
        for (std::size_t g = 0; g < surfaces.count; ++g)
            out = std::max(out, surfaces.starts[g + 1] - surfaces.starts[g]);
        return static_cast<std::size_t>(out);
    }

    bool clear() {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        std::fill(rows.begin(), rows.end(), Equations{});
        std::fill(sure.begin(), sure.end(), Matrix8{});
        std::fill(left_, left_ + outline_.count, nan);
        std::fill(weight_, weight_ + outline_.count, 0.0);
        for (Row8 &row : basis) row.fill(nan);
        step.fill(nan);
        centre = {nan, nan};
        radius = scatter = nan;
        return false;
    }

    double scattered() {
        std::size_t n = 0;
        for (std::size_t i = 0; i < outline_.count; ++i) {
            size_[n] = std::fabs(left_[i]);
            n += std::isfinite(left_[i]) ? 1 : 0;
        }
        if (n == 0) return std::numeric_limits<double>::quiet_NaN();
        return 1.4826 * 0.5 * (select_(size_.data(), n, (n - 1) / 2) + select_(size_.data(), n, n / 2));
    }

    // The whitened motion that the evidence in use asks for.
    void asked(const Stepping &rules) {
        Matrix8 S{}, L;
        Row8 b{};
        for (int i = 0; i < 8; ++i) S[i][i] = 1.0 / (rules.loose * rules.loose);
        for (std::size_t g = 0; g < rows.size(); ++g) {
            if (!rules.use[g] || !(rows[g].noise > 0.0)) continue;
            const double noise = rows[g].noise * (g == 0 ? 1.0 : rules.caution), share = 1.0 / (noise * noise);
            for (int r = 0; r < 8; ++r) {
                b[r] += share * rows[g].b[r];
                for (int c = 0; c < 8; ++c) S[r][c] += share * rows[g].N[r][c];
            }
        }
        step.fill(std::numeric_limits<double>::quiet_NaN());
        if (cholesky(S, 0.0, 8, L)) step = backward(L, forward(L, b, 8), 8);
    }

    bool look() {
        std::fill(rows.begin(), rows.end(), Equations{});
        if (!outline()) return false;
        for (std::size_t g = 0; g < surfaces_.count; ++g) {
            const std::int64_t start = surfaces_.starts[g];
            fit_.add(H, centre, radius, basis,
                     {surfaces_.places + start, surfaces_.slopes + start, surfaces_.values + start,
                      static_cast<std::size_t>(surfaces_.starts[g + 1] - start)},
                     rows[g + 1]);
        }
        return true;
    }

    bool outline() {
        const std::size_t m = outline_.count;
        const double *strength = outline_.strength;
        std::fill(left_, left_ + m, std::numeric_limits<double>::quiet_NaN());
        std::fill(weight_, weight_ + m, 0.0);
        carry_normals(H, outline_.points, outline_.normals, static_cast<std::int64_t>(m), moved_.data());
        centre = {0, 0};
        for (std::size_t i = 0; i < m; ++i) {
            for (int j = 0; j < 5; ++j)
                if (!std::isfinite(moved_[5 * i + j])) return false;
            at_[i] = {moved_[5 * i], moved_[5 * i + 1]};
            along_[i] = {moved_[5 * i + 2], moved_[5 * i + 3]};
            centre = centre + at_[i];
        }
        centre = (1.0 / static_cast<double>(m)) * centre;
        double spread = 0.0;
        for (std::size_t i = 0; i < m; ++i) spread += dot(at_[i] - centre, at_[i] - centre);
        radius = std::sqrt(spread / static_cast<double>(m));
        Motions motions(m, 8);
        for (std::size_t i = 0; i < m; ++i) {
            const Vec place = (1.0 / radius) * (at_[i] - centre);
            motions.set(i, place.x, place.y, along_[i].x, along_[i].y, 0.0);
        }
        motions.whiten();
        basis = motions.own;

        const RegisterRules &rules = outline_.rules;
        const auto direction = [&](std::size_t i) {
            if (rules.polarity != 0 || std::isinf(strength[i])) return rules.polarity;
            return strength[i] > 0 ? 1 : -1;
        };
        edge_search_each<false>(image_, {at_.data(), m}, along_.data(), outline_.reach, direction, edges_.data());
        leave_hidden_out(clear_, at_.data(), along_.data(), m, edges_.data());
        std::size_t strong = 0;
        for (std::size_t i = 0; i < m; ++i)
            if (std::isfinite(edges_[i].offset) && std::fabs(edges_[i].strength) >= rules.least_strength)
                gains_[strong++] = std::fabs(edges_[i].strength) / std::fabs(strength[i]);
        const double gain = strong == 0 ? 0.0 : select_(gains_.data(), strong, (strong - 1) / 2);
        std::size_t inside = 0, count = 0;
        for (std::size_t i = 0; i < m; ++i) {
            if (!(at_[i].x >= 1 && at_[i].y >= 1 && at_[i].x <= static_cast<double>(image_.width - 2) &&
                  at_[i].y <= static_cast<double>(image_.height - 2)))
                continue;
            if (std::isnan(edges_[i].strength)) continue;  // beside what is hidden nobody knows
            ++inside;
            const double slope = std::fabs(edges_[i].strength);
            if (!std::isfinite(edges_[i].offset) || slope < rules.least_strength ||
                !(slope >= rules.relative_strength * gain * std::fabs(strength[i])))
                continue;
            found_[count] = i;
            size_[count++] = std::fabs(edges_[i].offset);
        }
        if (count == 0) return true;
        Equations &row = rows[0];
        row.noise = std::max(select_(size_.data(), count, (count - 1) / 3) / kQuietSigma, kLeastNoisePx);
        const double by = 1.0 / (kTukey * row.noise);
        std::fill(motions.weights(), motions.weights() + m, 0.0);
        for (std::size_t k = 0; k < count; ++k) {
            const std::size_t i = found_[k];
            left_[i] = edges_[i].offset;
            weight_[i] = motions.weights()[i] = tukey_weight(edges_[i].offset, by);
            motions.set_offset(i, edges_[i].offset);
        }
        Matrix8 told{};
        Row8 b{};
        row.total = motions.normal_equations(told, b);
        row.N = without_chance(told, kSliding * kSliding * row.total, b, row.b);
        row.share = row.total / static_cast<double>(std::max<std::size_t>(inside, 1));
        row.correlation = static_cast<double>(inside) / static_cast<double>(m);
        return true;
    }

    Image<std::uint8_t> image_;
    Clear clear_;
    OutlineSamplesIn outline_;
    SurfacesIn surfaces_;
    double *left_, *weight_;
    std::vector<double> moved_;
    std::vector<Vec> at_, along_;
    std::vector<Edge> edges_;
    std::vector<double> gains_, size_;
    std::vector<std::size_t> found_;
    Selection select_;
    SurfaceFit fit_;
};

struct Seen {
    double size = 0.0, weighed = 0.0;
};

// The motion that solves N x = b, as far as N shows it: its size, and x' N x.
inline Seen seen_motion(const Matrix8 &N, const Row8 &b, double least) {
    Matrix8 V;
    const Row8 told = eigen(N, V);
    const double most = *std::max_element(told.begin(), told.end());
    Seen out;
    for (int e = 0; e < 8; ++e) {
        if (!(told[e] > least * most)) continue;
        double along = 0.0;
        for (int r = 0; r < 8; ++r) along += V[r][e] * b[r];
        along /= told[e];
        out.size += along * along;
        out.weighed += along * along * told[e];
    }
    out.size = std::sqrt(out.size);
    return out;
}

struct Spread {
    Vec centre;
    double radius, loose;
    const double *basis, *sure, *share;
    std::size_t rows;
};

// (2 k, 2 k) covariance of contacts.
inline void contact_covariance(const double *H, const Vec *contacts, std::size_t k, const Spread &in, double *out) {
    Matrix8 S{}, L;
    for (int i = 0; i < 8; ++i) S[i][i] = 1.0 / (in.loose * in.loose);
    for (std::size_t g = 0; g < in.rows; ++g)
        if (in.share[g] != 0.0)
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) S[r][c] += in.share[g] * in.sure[64 * g + 8 * r + c];
    const std::size_t n = 2 * k;
    if (!cholesky(S, 0.0, 8, L)) {
        std::fill(out, out + n * n, std::numeric_limits<double>::quiet_NaN());
        return;
    }
    std::vector<Row8> half(n);  // L^-1 B' f: the covariance of two is their product
    for (std::size_t i = 0; i < k; ++i) {
        const double w = H[6] * contacts[i].x + H[7] * contacts[i].y + H[8];
        const Vec at{(H[0] * contacts[i].x + H[1] * contacts[i].y + H[2]) / w,
                     (H[3] * contacts[i].x + H[4] * contacts[i].y + H[5]) / w};
        Row8 f[2];
        fields((at.x - in.centre.x) / in.radius, (at.y - in.centre.y) / in.radius, f[0], f[1]);
        for (int axis = 0; axis < 2; ++axis) {
            Row8 row{};
            for (int r = 0; r < 8; ++r)
                for (int c = 0; c < 8; ++c) row[c] += f[axis][r] * in.basis[8 * r + c];
            half[2 * i + static_cast<std::size_t>(axis)] = forward(L, row, 8);
        }
    }
    for (std::size_t r = 0; r < n; ++r)
        for (std::size_t c = 0; c <= r; ++c) {
            double sum = 0.0;
            for (int e = 0; e < 8; ++e) sum += half[r][e] * half[c][e];
            out[r * n + c] = out[c * n + r] = sum;
        }
}

}  // namespace grasptrack
