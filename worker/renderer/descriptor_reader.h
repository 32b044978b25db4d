#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "tessera/v1/render_settings.pb.h"
#include "worker/gltf/build/loader.h"
#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// Memory of a scene, bytes.
struct SceneMemory {
  std::int64_t texels = 0;  // of images; those beyond are mapped from a file
  std::uint64_t all = 0;    // of everything kept without file mappings
};

/// Reads a scene's resources from descriptors received from the agent, and from nothing else.
class DescriptorReader : public render::ResourceReader {
 public:
  /// `descriptors`: the manifest's assets in its order, each closed once it is mapped, then an
  /// unnamed file for the texels that exceed `memory.texels` in total.
  DescriptorReader(const v1::SceneManifest& manifest, std::vector<Descriptor> descriptors,
                   const SceneMemory& memory);
  ~DescriptorReader() override;
  DescriptorReader(const DescriptorReader&) = delete;
  DescriptorReader& operator=(const DescriptorReader&) = delete;

  /// Maps and returns a resource. Errors: NotFound, `uri` is not in the manifest; DataLoss, the
  /// file does not have the size in the manifest; ResourceExhausted, it cannot be mapped.
  absl::StatusOr<std::span<const std::byte>> read(std::string_view uri) override;
  /// Writes texels over the limit to the file and returns their mapping, whose pages the system can
  /// evict. Errors: ResourceExhausted, the file cannot be written or mapped.
  absl::StatusOr<std::shared_ptr<const std::byte>> spill(
      std::span<const std::byte> texels) override;
  std::uint64_t memory_bytes() const override { return memory_bytes_; }

 private:
  struct Resource {
    Descriptor descriptor;
    std::size_t size = 0;
    const std::byte* bytes = nullptr;  // mapped; null before the first read
  };
  std::map<std::string, Resource, std::less<>> resources_;
  const Descriptor scratch_;
  const std::uint64_t memory_bytes_;
  std::mutex mutex_;  // guards what follows
  std::int64_t texel_bytes_left_;
};

}  // namespace tessera::agent
