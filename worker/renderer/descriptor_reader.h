#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "tessera/v1/render_settings.pb.h"
#include "worker/ipc/descriptor.h"
#include "worker/gltf/build/loader.h"

namespace tessera::agent {

/// Reads a scene's resources from descriptors that were handed over: nothing else exists for it.
class DescriptorReader : public render::ResourceReader {
 public:
  /// `descriptors` are those of the manifest's assets, in its order, which are closed once mapped,
  /// and last a nameless file: for texels that are over `texel_bytes` in all.
  DescriptorReader(const v1::SceneManifest& manifest, std::vector<Descriptor> descriptors,
                   std::int64_t texel_bytes);
  ~DescriptorReader() override;
  DescriptorReader(const DescriptorReader&) = delete;
  DescriptorReader& operator=(const DescriptorReader&) = delete;

  /// Errors: NotFound, the manifest does not name `uri`; DataLoss, the file has another size than
  /// the manifest says; ResourceExhausted, it cannot be mapped.
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;
  /// Maps what it has written to the file; the system takes such pages away when memory is short.
  absl::StatusOr<std::shared_ptr<const std::byte>> set_aside(
      std::span<const std::byte> texels) override;

 private:
  struct Resource {
    Descriptor descriptor;
    std::size_t size = 0;
    const std::byte* bytes = nullptr;  // mapped; null before the first read
  };
  std::map<std::string, Resource, std::less<>> resources_;
  const Descriptor scratch_;
  std::mutex mutex_;  // guards what follows
  std::int64_t texel_bytes_left_;
};

}  // namespace tessera::agent
