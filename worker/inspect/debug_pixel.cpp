#include "worker/inspect/debug_pixel.h"

#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "worker/render/frame_renderer.h"
#include "worker/render/path/path_observer.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {
namespace {

/// Formats with the digits that identify a float.
std::string text_of(float value) {
  return absl::StrFormat("%.9g", value);
}

std::string text_of(const Vec3f& v) {
  return absl::StrFormat("(%.9g, %.9g, %.9g)", v.x, v.y, v.z);
}

const char* name_of(RadianceSource source) {
  switch (source) {
    case RadianceSource::unlit:
      return "unlit surface";
    case RadianceSource::emission:
      return "emission";
    case RadianceSource::environment:
      return "environment";
    case RadianceSource::direct:
      return "sampled light";
    case RadianceSource::medium_light:
      return "sampled light in the medium";
    case RadianceSource::medium_emission:
      return "emission of the medium";
  }
  return "";
}

const char* name_of(Interface interface) {
  switch (interface) {
    case Interface::opaque:
      return "opaque";
    case Interface::thin:
      return "thin";
    case Interface::solid:
      return "solid";
  }
  return "";
}

/// Writes the events of a path as text.
class PathPrinter final : public PathObserver {
 public:
  explicit PathPrinter(const Scene& scene) : scene_(scene) {}

  void on_second_path(const Vec2f& offset) override {
    absl::StrAppend(&text_, "second path, towards a small image of a light, ",
                    absl::StrFormat("%.4g, %.4g", offset.x, offset.y),
                    " px from the pixel's centre\n");
    vertex_count_ = 0;
  }

  void on_vertex(const Vertex& vertex) override {
    const ShadingPoint& point = vertex.point;
    absl::StrAppend(&text_, "vertex ", vertex_count_++, ", depth ", vertex.depth, "\n");
    line("ray", absl::StrCat("from ", world(vertex.ray.origin), " along ",
                             text_of(vertex.ray.direction), ", time ", text_of(vertex.ray.time)));
    line("hit", absl::StrCat("t ", text_of(vertex.hit.t), ", position ", world(vertex.position)));
    line("surface", surface_text(vertex));
    line("normals",
         absl::StrCat("geometric ", text_of(point.geometric_normal), ", shading ",
                      text_of(vertex.bsdf.frame.normal), point.front ? ", front" : ", back"));
    line("bsdf", bsdf_text(vertex.bsdf));
    if (vertex.bsdf.extended) line("lobes", extended_text(*vertex.bsdf.extended));
    line("throughput", text_of(vertex.throughput));
  }

  void on_miss(const Ray& ray, const Vec3f& throughput) override {
    absl::StrAppend(&text_, "miss\n");
    line("ray", absl::StrCat("from ", world(ray.origin), " along ", text_of(ray.direction),
                             ", time ", text_of(ray.time)));
    line("throughput", text_of(throughput));
  }

  void on_radiance(RadianceSource source, const Vec3f& radiance, float mis_weight) override {
    line("radiance", absl::StrCat("+ ", text_of(radiance), " from ", name_of(source),
                                  ", MIS weight ", text_of(mis_weight)));
  }

  void on_pass(const Vec3f& throughput) override {
    line("pass", absl::StrCat("without scattering, throughput ", text_of(throughput)));
  }

  void on_medium(const MediumView& medium, const Vec3f& position,
                 const Vec3f& throughput) override {
    absl::StrAppend(&text_, "collision in a medium\n");
    line("position", world(position));
    line("medium", absl::StrCat("extinction ", text_of(medium.extinction), ", scattering ",
                                text_of(medium.scattering), ", emission ", text_of(medium.emission),
                                ", anisotropy ", text_of(medium.anisotropy)));
    line("throughput", text_of(throughput));
  }

  void on_scatter(const BsdfSample& sample, const Vec3f& throughput) override {
    line("scatter", absl::StrCat(sample.transmitted ? "transmitted" : "reflected",
                                 sample.delta ? ", specular" : "", ", direction ",
                                 text_of(sample.wi), ", pdf ", text_of(sample.pdf), ", weight ",
                                 text_of(sample.weight), ", throughput ", text_of(throughput)));
  }

  void on_roulette(float survival, bool survived, const Vec3f& throughput) override {
    line("roulette", absl::StrCat("probability ", text_of(survival),
                                  survived ? ", survived, throughput " : ", ended, throughput ",
                                  text_of(throughput)));
  }

  void on_max_depth(bool continued) override {
    absl::StrAppend(&text_, "maximum depth reached",
                    continued ? "; what follows estimates the truncated radiance and is not part "
                                "of the image\n"
                              : "\n");
  }

  std::string take_text() { return std::move(text_); }

 private:
  void line(const char* name, const std::string& value) {
    absl::StrAppend(&text_, absl::StrFormat("  %-11s", name), value, "\n");
  }

  /// World coordinates of a recentred position.
  std::string world(const Vec3f& position) const {
    return text_of(Vec3f(Vec3d(position) + scene_.center));
  }

  static std::string surface_text(const Vertex& vertex) {
    const ShadingPoint& point = vertex.point;
    const std::string& material = point.material->source->name;
    return absl::StrCat("node ", point.instance->node,
                        point.shape != nullptr
                            ? absl::StrCat(", shape face ", point.face)
                            : absl::StrCat(", primitive ", vertex.hit.id.primitive, ", triangle ",
                                           vertex.hit.id.triangle),
                        ", material ", point.primitive->material,
                        material.empty() ? "" : absl::StrCat(" \"", material, "\""));
  }

  static std::string bsdf_text(const Bsdf& bsdf) {
    std::string text = name_of(bsdf.interface);
    absl::StrAppend(&text, ", diffuse ", text_of(bsdf.diffuse));
    if (bsdf.lambert) return text;
    absl::StrAppend(&text, ", f0 ", text_of(bsdf.f0), ", metallic ", text_of(bsdf.metallic),
                    ", roughness ", text_of(bsdf.roughness), ", alpha ", text_of(bsdf.alpha),
                    bsdf.mirror ? ", specular" : "", ", transmission ", text_of(bsdf.transmit));
    if (bsdf.interface == Interface::solid) absl::StrAppend(&text, ", eta ", text_of(bsdf.eta));
    return text;
  }

  static std::string extended_text(const ExtendedLobes& lobes) {
    return absl::StrCat("clearcoat ", text_of(lobes.coat.weight), " alpha ",
                        text_of(lobes.coat.alpha), lobes.coat.mirror ? " specular" : "", ", sheen ",
                        text_of(lobes.sheen.color), " roughness ", text_of(lobes.sheen.roughness),
                        ", anisotropy ", text_of(lobes.anisotropy), ", diffuse transmission ",
                        text_of(lobes.diffuse_transmit));
  }

  const Scene& scene_;
  std::string text_;
  int vertex_count_ = 0;
};

}  // namespace

absl::StatusOr<std::string> debug_pixel(const Scene& scene,
                                        const contract::RenderSettings& settings,
                                        const DebugPixelRequest& request) {
  if (request.x < 0 || request.y < 0 || request.x >= settings.width ||
      request.y >= settings.height) {
    return absl::InvalidArgumentError(absl::StrCat("pixel ", request.x, ",", request.y,
                                                   " is outside the frame of ", settings.width, "x",
                                                   settings.height));
  }
  const auto renderer = FrameRenderer::create(scene, settings, request.frame, sequential());
  if (!renderer.ok()) return renderer.status();
  PathPrinter printer(scene);
  const FrameRenderer::Sample sample =
      (*renderer)->trace_sample(request.x, request.y, request.sample, printer);
  const auto [r, g, b] = sample.radiance;
  return absl::StrCat(printer.take_text(), "sample ", request.sample, " of pixel ", request.x, ",",
                      request.y, ", frame ", request.frame, ": radiance ", text_of(Vec3f{r, g, b}),
                      ", alpha ", text_of(sample.alpha), "\n");
}

}  // namespace tessera::render
