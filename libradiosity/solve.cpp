#include "libradiosity/solve.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "libradiosity/form_factor.h"
#include "libradiosity/visibility.h"
#include "libscene/parallel.h"
#include "libscene/sampling.h"

namespace lmc {

namespace {

// The ladder, by q = distance of centres / sum of radii. Errors of each rung at its limit: disc form 0.3 % at 6, three Lambert points 0.2 %
// at 1.5.
constexpr double kFar = 6.0, kNear = 1.5;
constexpr std::size_t kPanels = 64;  // of an edge beside an almost parallel one: visible shares are known to far less
constexpr std::uint32_t kClosureRays = 256;
constexpr int kScalings = 50;

struct LeafShape {
  std::array<glm::dvec3, 3> corner;
  glm::dvec3 centre, normal;
  double area = 0.0, radius = 0.0;
};

LeafShape shapeOf(const Scene& scene, const Leaf& leaf, bool back) {
  LeafShape s;
  s.corner = leafCorners(scene, leaf, back);
  s.centre = (s.corner[0] + s.corner[1] + s.corner[2]) / 3.0;
  s.area = area_m2(s.corner);
  s.normal = glm::normalize(glm::cross(s.corner[1] - s.corner[0], s.corner[2] - s.corner[0]));
  for (const glm::dvec3& c : s.corner) s.radius = std::max(s.radius, glm::distance(c, s.centre));
  return s;
}

double leafExchange_m2(const LeafShape& a, const LeafShape& b) {
  const double q = glm::distance(a.centre, b.centre) / (a.radius + b.radius);
  if (q > kFar)
    return 0.5 * (a.area * elementToDisc(a.centre, a.normal, b.centre, b.normal, b.area) +
                  b.area * elementToDisc(b.centre, b.normal, a.centre, a.normal, a.area));
  if (q <= kNear) return exchangeArea_m2(std::span<const glm::dvec3>(a.corner), std::span<const glm::dvec3>(b.corner), kPanels);
  // Three-point rule of degree 2 on the smaller triangle, the other in closed form.
  const LeafShape &small = a.area <= b.area ? a : b, &large = a.area <= b.area ? b : a;
  double sum = 0.0;
  for (std::size_t k = 0; k < 3; ++k)
    sum += elementToPolygon(small.corner[k] / 1.5 + small.corner[(k + 1) % 3] / 6.0 + small.corner[(k + 2) % 3] / 6.0, small.normal,
                            large.corner) /
           3.0;
  return small.area * sum;
}

}  // namespace

double exchangeArea_m2(const Scene& scene, const PatchMesh& mesh, std::uint32_t i, std::uint32_t j) {
  const Patch &a = mesh.patches[i], &b = mesh.patches[j];
  if (i == j || !mayFace(a, b)) return 0.0;
  const double q = glm::distance(a.centre_m, b.centre_m) / (a.radius_m + b.radius_m);
  if (q > kFar)
    return 0.5 * (a.area_m2 * elementToDisc(a.centre_m, a.normal, b.centre_m, b.normal, b.area_m2) +
                  b.area_m2 * elementToDisc(b.centre_m, b.normal, a.centre_m, a.normal, a.area_m2));
  double sum = 0.0, wholeA = 0.0, wholeB = 0.0;
  for (std::uint32_t k = 0; k < a.leafCount; ++k) {
    const LeafShape la = shapeOf(scene, mesh.leaves[a.firstLeaf + k], a.back);
    wholeA += la.area;
    wholeB = 0.0;
    for (std::uint32_t m = 0; m < b.leafCount; ++m) {
      const LeafShape lb = shapeOf(scene, mesh.leaves[b.firstLeaf + m], b.back);
      wholeB += lb.area;
      sum += leafExchange_m2(la, lb);
    }
  }
  return sum * (a.area_m2 / wholeA) * (b.area_m2 / wholeB);  // holes of either side take their share
}

FormFactors computeFormFactors(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const Run& run) {
  FormFactors f;
  f.size = mesh.patches.size();
  const std::size_t n = f.size;
  f.exchange_m2.assign(n * n, 0.0f);
  f.closure.assign(n, 0.0);
  parallelFor(run, n, 1, [&](std::size_t i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      const double g = exchangeArea_m2(scene, mesh, std::uint32_t(i), std::uint32_t(j));
      if (g <= 0.0) continue;
      f.exchange_m2[i * n + j] = float(g * visibleShare(scene, tracer, mesh, std::uint32_t(i), std::uint32_t(j), run));
    }
    // Closure: what leaves i meets a front, a back, or the sky.
    const Patch& patch = mesh.patches[i];
    const Sobol4 numbers = sequence(run.seed, Draw::Closure, 0, 0, std::uint32_t(i), 0, 0);
    std::array<Ray, kClosureRays> rays;
    std::array<Hit, kClosureRays> hits;
    for (std::uint32_t k = 0; k < kClosureRays; ++k) {
      const glm::vec4 u = numbers.point(k);
      const auto [triangle, bary] = mesh.sample(patch, {u.z, u.w});
      const SurfacePoint p = surfacePoint(scene, triangle, bary);
      const glm::dvec3 normal = patch.back ? -p.geometricNormal : p.geometricNormal;
      rays[k] = {tracer.lifted(p.position_m, normal), glm::vec3(frameAbout(normal) * cosineHemisphere({u.x, u.y})), INFINITY};
    }
    tracer.closest(rays, hits, Purpose::Visibility);
    std::uint32_t met = 0, backs = 0;
    for (const Hit& h : hits) {
      if (!h) continue;
      ++(mesh.patchAt(h.triangle, h.bary, h.front) != kNone ? met : backs);
    }
    const std::uint32_t from = patch.exposed == 0xffff ? kClosureRays : kClosureRays - backs;  // rays of buried parts do not count
    f.closure[i] = from > 0 ? double(met) / from : 0.0;
  });
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) f.exchange_m2[i * n + j] = f.exchange_m2[j * n + i];

  // Symmetric scaling, d_i sum_j G_ij d_j = A_i closure_i: row sums become right and A_i F_ij stays equal to A_j F_ji.
  std::vector<double> d(n, 1.0), row(n);
  double area = 0.0;
  for (int step = 0; step < kScalings; ++step) {
    parallelFor(run.quiet(), n, 16, [&](std::size_t i) {
      double sum = 0.0;
      for (std::size_t j = 0; j < n; ++j) sum += double(f.exchange_m2[i * n + j]) * d[j];
      row[i] = sum;
    });
    double worst = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double wanted = mesh.patches[i].area_m2 * f.closure[i];
      if (step == 0) {
        f.closureError += std::abs(row[i] - wanted);
        area += mesh.patches[i].area_m2;
      }
      if (!(row[i] > 0.0) || !(wanted > 0.0)) {
        d[i] = row[i] > 0.0 ? 0.0 : d[i];
        continue;
      }
      const double ratio = wanted / (d[i] * row[i]);
      worst = std::max(worst, std::abs(ratio - 1.0));
      d[i] *= std::sqrt(std::clamp(ratio, 0.25, 4.0));
    }
    if (worst < 1e-9) break;
  }
  f.closureError /= std::max(area, 1e-300);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) f.exchange_m2[i * n + j] = float(double(f.exchange_m2[i * n + j]) * d[i] * d[j]);
  return f;
}

Solution solveDense(const PatchMesh& mesh, const FormFactors& f, const PatchLight& light, const SolveOptions& options) {
  const auto n = Eigen::Index(f.size);
  Solution out;
  out.illuminance.assign(f.size, Rgb(0.0f));
  out.stop = Stop::Energy;
  using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const RowMajor> G(f.exchange_m2.data(), n, n);
  Eigen::VectorXd area(n);
  for (Eigen::Index i = 0; i < n; ++i) area[i] = mesh.patches[std::size_t(i)].area_m2;
  // y_i = sum_j G_ij v_j, a row at a time in double.
  const auto multiply = [&](const Eigen::VectorXd& v) {
    Eigen::VectorXd y(n);
    for (Eigen::Index i = 0; i < n; ++i) y[i] = G.row(i).cast<double>().dot(v.transpose());
    return y;
  };
  for (int c = 0; c < 3; ++c) {
    Eigen::VectorXd E(n), root(n);  // root_i = sqrt(rho_i / A_i): S = root G root
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::size_t k = std::size_t(i);
      const double rho = double(mesh.patches[k].reflectance[c]);
      E[i] = double(light.direct[k][c]) + double(light.sky[k][c]);
      root[i] = area[i] > 0.0 ? std::sqrt(rho / area[i]) : 0.0;
      out.energy.sent[c] += area[i] * rho * E[i];
    }
    // b_i = M_i sqrt(A_i/rho_i) with M = rho E, that is E sqrt(A rho).
    const Eigen::VectorXd b = (E.array() * area.array() * root.array()).matrix();
    Eigen::VectorXd x = b;
    const auto apply = [&](const Eigen::VectorXd& v) {
      return Eigen::VectorXd(v - (root.array() * multiply((root.array() * v.array()).matrix()).array()).matrix());
    };
    Eigen::VectorXd r = b - apply(x), p = r;
    double rr = r.squaredNorm();
    const double limit = options.maxRelativeResidual * b.norm();
    int k = 0;
    for (; k < options.maxIterations && std::sqrt(rr) > limit; ++k) {
      const Eigen::VectorXd Ap = apply(p);
      const double alpha = rr / p.dot(Ap);
      x += alpha * p;
      r -= alpha * Ap;
      const double next = r.squaredNorm();
      p = r + (next / rr) * p;
      rr = next;
    }
    if (k == options.maxIterations) out.stop = Stop::Passes;
    out.passes = std::max(out.passes, k);
    // B_i A_i = x_i sqrt(A_i rho_i); H_i = 1/A_i sum_j G_ij B_j.
    const Eigen::VectorXd B = (x.array() * root.array()).matrix();
    const Eigen::VectorXd H = multiply(B);
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::size_t s = std::size_t(i);
      const double h = area[i] > 0.0 ? std::max(0.0, H[i] / area[i]) : 0.0;
      out.illuminance[s][c] = float(h);
      out.energy.absorbed[c] += (1.0 - double(mesh.patches[s].reflectance[c])) * area[i] * h;
      out.energy.left[c] += area[i] * B[i] * (1.0 - f.closure[s]);  // backs and sky together: the matrix knows fronts only
    }
  }
  return out;
}

}  // namespace lmc
