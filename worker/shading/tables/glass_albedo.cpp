#include "worker/shading/tables/glass_albedo.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "worker/shading/tables/facet_quadrature.h"

namespace tessera::render {
namespace {

/// Quadrature over the visible normals, in two groups: light that is totally reflected, and other
/// light, of which facets reflect s + f0 (1 - s).
struct Parts {
  double a = 0, b = 0, total = 0;     // reflected, as in ReflectedAlbedo
  double passed_a = 0, passed_b = 0;  // transmitted: the same with 1 - s and s
  double most = 0;
};

/// The exact Fresnel term, for c^2 + eta^2 - 1 = g^2 >= 0.
double exact_fresnel(double c, double g, double eta) {
  const double a = (eta - 1) * (eta + 1) / ((g + c) * (g + c));
  const double b = (c * (g + c) - 1) / (c * (g - c) + 1);
  return 0.5 * a * a * (1 + b * b);
}

constexpr std::size_t kLanes = 8;
using Lanes = std::array<double, kLanes>;

void add(const Lanes& lanes, double* sum) {
  for (const double lane : lanes) *sum += lane;
}

/// Albedos for light leaving at `cos_o`.
Parts integrate(const VisibleNormals& normals, double cos_o, double alpha, double eta) {
  const Vec3d wo{std::sqrt((1 - cos_o) * (1 + cos_o)), 0, cos_o};
  const double root_o = smith_root(cos_o, alpha);
  const double n2 = (eta - 1) * (eta + 1);
  const double normal = (eta - 1) * (eta - 1) / ((eta + 1) * (eta + 1));
  Parts sum;
  for (std::size_t first = 0; first < normals.u.size(); first += kLanes) {
    Lanes a{}, b{}, total{}, passed_a{}, passed_b{}, most{};
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::size_t i = first + k;
      const Vec3d h =
          sample_visible_normal(wo, alpha, normals.cosine[i], normals.sine[i], normals.u[i]);
      const double c = dot(wo, h), g2 = n2 + c * c;
      const double g = std::sqrt(g2 > 0 ? g2 : 0);
      const double f = g2 > 0 ? exact_fresnel(c, g, eta) : 1;
      const double up = 2 * c * h.z - cos_o, down = (cos_o - h.z * (c - g)) / eta;
      const double z_r = up > 0 ? up : 0, z_t = down > 0 ? down : 0;
      const double r = scattered_share(cos_o, root_o, z_r, smith_root(z_r, alpha));
      const double t = scattered_share(cos_o, root_o, z_t, smith_root(z_t, alpha));
      const double s = (f - normal) / (1 - normal);
      const double beyond = g2 > 0 ? 0.0 : normals.weight[i], within = normals.weight[i] - beyond;
      a[k] = within * (1 - s) * r;
      b[k] = within * s * r;
      total[k] = beyond * r;
      passed_a[k] = within * (1 - s) * t;
      passed_b[k] = within * s * t;
      most[k] = beyond * r + within * (r > t ? r : t);
    }
    add(a, &sum.a);
    add(b, &sum.b);
    add(total, &sum.total);
    add(passed_a, &sum.passed_a);
    add(passed_b, &sum.passed_b);
    add(most, &sum.most);
  }
  return sum;
}

/// Coordinate of a cosine for reflected light. Inside, albedos of smooth lobes have a step at the
/// critical angle, of cosine `critical`, where nodes are densest.
float reflected_height(float cosine, float alpha, float critical) {
  if (!(critical > 0)) return albedo_grid::height_of(cosine, alpha);
  if (cosine < critical) return 0.5f - 0.5f * std::sqrt(1 - cosine / critical);
  return 0.5f + 0.5f * std::sqrt((cosine - critical) / (1 - critical));
}

/// Inverse of reflected_height().
double reflected_cosine(double height, double alpha, double critical) {
  if (!(critical > 0)) return albedo_grid::cosine_of(height, alpha);
  const double x = 2 * height - 1;
  const double c = x < 0 ? critical * (1 - x * x) : critical + (1 - critical) * (x * x);
  return std::max(c, 1e-6);
}

double critical_cosine(double eta) {
  return eta < 1 ? std::sqrt((1 - eta) * (1 + eta)) : 0;
}

constexpr double kSmoothError = 4e-4;  // of the quadrature of smooth integrands

/// Stores `values`, rounded up, as one field of the nodes. `error` is that of the quadrature.
template <typename Node>
void store(const std::vector<double>& values, std::size_t heights, double error, float Node::*field,
           std::vector<Node>* nodes) {
  constexpr double kSafety = 2;
  std::vector<double> bound(values.size(), error);
  albedo_grid::add_interpolation_error(values, heights, 1, true, kSafety, bound);
  albedo_grid::add_interpolation_error(values, values.size() / heights, heights, true, kSafety,
                                       bound);
  nodes->resize(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    (*nodes)[i].*field = static_cast<float>(values[i] + bound[i]);
  }
}

ScatteredAlbedo blend(const ScatteredAlbedo& p, const ScatteredAlbedo& q, float f) {
  return {lerp(p.mirrors, q.mirrors, f), lerp(p.grazing_only, q.grazing_only, f),
          lerp(p.passing, q.passing, f), lerp(p.most, q.most, f)};
}

ReflectedAlbedo blend(const ReflectedAlbedo& p, const ReflectedAlbedo& q, float f) {
  return {lerp(p.a, q.a, f), lerp(p.b, q.b, f), lerp(p.total, q.total, f)};
}

/// Interpolates between a node, the next and the same two of the next row, `heights` further on.
template <typename Node>
Node interpolate(const Node* low, std::size_t heights, float across, float up) {
  const Node* high = low + heights;
  return blend(blend(low[0], low[1], across), blend(high[0], high[1], across), up);
}

}  // namespace

GlassTable::GlassTable(double eta, const GlassTableParts& parts, double grid_eta)
    : eta_(eta), parts_(parts), critical_(critical_cosine(grid_eta)) {
  if (parts.scattered) fill_scattered();
  if (!parts.reflected) return;
  fill_reflected();
  fill_means();
}

GlassTable::Rows GlassTable::rows() const {
  const auto below = [](float roughness) {
    return albedo_grid::position(albedo_grid::fineness_of(roughness), kRows).index;
  };
  // Interpolation uses the row below and the next; rounding up looks at two more on each side.
  const std::size_t first = below(parts_.min_roughness), last = below(parts_.max_roughness);
  return {first < 2 ? 0 : first - 2, std::min(last + 4, kRows)};
}

void GlassTable::fill_scattered() {
  const VisibleNormals normals(512);
  std::vector<double> mirrors(kRows * kHeights), grazing_only(mirrors), passing(mirrors),
      most(mirrors);
  for (std::size_t r = rows().first; r < rows().end; ++r) {
    const double roughness = albedo_grid::roughness_of(albedo_grid::node(r, kRows));
    const double alpha = roughness * roughness;
    for (std::size_t i = 0; i < kHeights; ++i) {
      const double c = albedo_grid::cosine_of(albedo_grid::node(i, kHeights), alpha);
      const Parts e = integrate(normals, c, alpha, eta_);
      const std::size_t at = r * kHeights + i;
      mirrors[at] = e.a + e.b + e.total;
      grazing_only[at] = e.b + e.total + e.passed_a;
      passing[at] = e.total + e.passed_a + e.passed_b;
      most[at] = e.most;
    }
  }
  // Inside, the integrands have a step at the critical angle, or a steep slope.
  const double slope = eta_ < 1 ? 2e-3 : 1e-3, step = eta_ < 1 ? 6e-3 : 1e-3;
  store(mirrors, kHeights, kSmoothError, &ScatteredAlbedo::mirrors, &scattered_);
  store(grazing_only, kHeights, slope, &ScatteredAlbedo::grazing_only, &scattered_);
  store(passing, kHeights, step, &ScatteredAlbedo::passing, &scattered_);
  store(most, kHeights, slope, &ScatteredAlbedo::most, &scattered_);
}

void GlassTable::fill_reflected() {
  const VisibleNormals normals(512);
  std::vector<double> a(kRows * kHeights), b(a), total(a);
  for (std::size_t r = rows().first; r < rows().end; ++r) {
    const double roughness = albedo_grid::roughness_of(albedo_grid::node(r, kRows));
    const double alpha = roughness * roughness;
    for (std::size_t i = 0; i < kHeights; ++i) {
      const double c = reflected_cosine(albedo_grid::node(i, kHeights), alpha, critical_);
      const Parts e = integrate(normals, c, alpha, eta_);
      const std::size_t at = r * kHeights + i;
      a[at] = e.a;
      b[at] = e.b;
      total[at] = e.total;
    }
  }
  store(a, kHeights, kSmoothError, &ReflectedAlbedo::a, &reflected_);
  store(b, kHeights, kSmoothError, &ReflectedAlbedo::b, &reflected_);
  store(total, kHeights, eta_ < 1 ? 3e-3 : kSmoothError, &ReflectedAlbedo::total, &reflected_);
}

void GlassTable::fill_means() {
  constexpr int kSteps = 1024;       // midpoint rule over the interpolation, so that both agree
  constexpr std::size_t kFiner = 4;  // nodes of means_ per row
  for (std::size_t r = kFiner * rows().first; r < means_.size(); ++r) {
    if (r > kFiner * (rows().end - 1)) break;
    const auto roughness =
        static_cast<float>(albedo_grid::roughness_of(albedo_grid::node(r, means_.size())));
    const Row at = row(roughness);
    for (int k = 0; k < kSteps; ++k) {
      const float x = (static_cast<float>(k) + 0.5f) / kSteps;
      const float weight = 4 * x * x * x / kSteps;
      const ReflectedAlbedo e = reflected(at, x * x);
      means_[r].a += e.a * weight;
      means_[r].b += e.b * weight;
      // Rounded up, all together may exceed 1, which their users take for 1.
      const float excess = e.a + e.b + e.total - 1;
      means_[r].total += (e.total - (excess > 0 ? excess : 0)) * weight;
    }
  }
}

ScatteredAlbedo GlassTable::scattered(float cosine, float roughness) const {
  const albedo_grid::Position p = albedo_grid::position(albedo_grid::fineness_of(roughness), kRows);
  constexpr auto kLeast = static_cast<float>(albedo_grid::kMinRoughness);
  const float r = clamp(roughness, kLeast, 1.0f);
  const albedo_grid::Position i =
      albedo_grid::position(albedo_grid::height_of(cosine, r * r), kHeights);
  return interpolate(&scattered_[p.index * kHeights + i.index], kHeights, i.fraction, p.fraction);
}

GlassTable::Row GlassTable::row(float roughness) const {
  if (reflected_.empty()) return {};
  const albedo_grid::Position p = albedo_grid::position(albedo_grid::fineness_of(roughness), kRows);
  constexpr auto kLeast = static_cast<float>(albedo_grid::kMinRoughness);
  const float r = clamp(roughness, kLeast, 1.0f);
  return {&reflected_[p.index * kHeights], p.fraction, r * r, static_cast<float>(critical_)};
}

ReflectedAlbedo GlassTable::reflected(const Row& row, float cosine) {
  const albedo_grid::Position i =
      albedo_grid::position(reflected_height(cosine, row.alpha, row.critical), kHeights);
  return interpolate(row.nodes + i.index, kHeights, i.fraction, row.fraction);
}

ReflectedAlbedo GlassTable::mean_reflected(float roughness) const {
  const albedo_grid::Position p =
      albedo_grid::position(albedo_grid::fineness_of(roughness), means_.size());
  return blend(means_[p.index], means_[p.index + 1], p.fraction);
}

void GlassTable::cover(const GlassTable& other) {
  for (std::size_t i = 0; i < scattered_.size(); ++i) {
    ScatteredAlbedo& e = scattered_[i];
    const ScatteredAlbedo& o = other.scattered_[i];
    e = {std::max(e.mirrors, o.mirrors), std::max(e.grazing_only, o.grazing_only),
         std::max(e.passing, o.passing), std::max(e.most, o.most)};
  }
  for (std::size_t i = 0; i < reflected_.size(); ++i) {
    ReflectedAlbedo& e = reflected_[i];
    const ReflectedAlbedo& o = other.reflected_[i];
    e = {std::max(e.a, o.a), std::max(e.b, o.b), std::max(e.total, o.total)};
  }
  for (std::size_t r = 0; r < means_.size(); ++r) {
    ReflectedAlbedo& e = means_[r];
    const ReflectedAlbedo& o = other.means_[r];
    e = {std::min(e.a, o.a), std::min(e.b, o.b), std::min(e.total, o.total)};
  }
}

}  // namespace tessera::render
