// Parts of the agent that use the operating system: sockets with descriptors, threads, the asset
// cache.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "worker/agent/server/asset_cache.h"
#include "worker/ipc/message_socket.h"
#include "worker/renderer/descriptor_reader.h"
#include "worker/renderer/render_pool.h"

namespace tessera::agent {
namespace {

namespace fs = std::filesystem;

class Folder {
 public:
  Folder() {
    std::string name = fs::temp_directory_path() / "tessera-agent-XXXXXX";
    path_ = ::mkdtemp(name.data());
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// An open, unlinked file with the given text.
Descriptor file_with(const std::string& text) {
  Folder folder;
  const std::string path = folder.path() + "/file";
  std::ofstream(path) << text;
  return Descriptor(::open(path.c_str(), O_RDWR | O_CLOEXEC));
}

std::string contents(const Descriptor& file) {
  std::string text(64, '\0');
  const ssize_t got = ::pread(file.get(), text.data(), text.size(), 0);
  text.resize(got < 0 ? 0 : static_cast<std::size_t>(got));
  return text;
}

struct SocketPair {
  std::pair<Descriptor, Descriptor> ends = *socket_pair();
  MessageSocket left{std::move(ends.first)}, right{std::move(ends.second)};
};

TEST(MessageSocket, AnySizeArrivesWholeAndInOrder) {
  SocketPair pair;
  std::thread sender([&pair] {
    for (const std::size_t size : {0u, 1u, 3u, 4u, 65536u, 3'000'000u}) {
      ASSERT_TRUE(pair.left.send(std::string(size, static_cast<char>('a' + size % 26))).ok());
    }
  });
  for (const std::size_t size : {0u, 1u, 3u, 4u, 65536u, 3'000'000u}) {
    const auto message = pair.right.receive();
    ASSERT_TRUE(message.ok() && message->has_value());
    EXPECT_EQ(**message, std::string(size, static_cast<char>('a' + size % 26)));
  }
  sender.join();
}

TEST(MessageSocket, ManyDescriptorsArriveInOrder) {
  constexpr std::size_t kCount = 450;  // three batches
  SocketPair pair;
  std::vector<Descriptor> files;
  std::vector<int> numbers;
  for (std::size_t i = 0; i < kCount; ++i) {
    files.push_back(file_with("file " + std::to_string(i)));
    numbers.push_back(files.back().get());
  }
  std::thread sender([&] {
    ASSERT_TRUE(pair.left.send("before", numbers).ok());
    ASSERT_TRUE(pair.left.send("after").ok());
  });
  EXPECT_EQ(**pair.right.receive(), "before");
  const auto received = pair.right.receive_descriptors(kCount);
  ASSERT_TRUE(received.ok()) << received.status();
  for (std::size_t i = 0; i < kCount; ++i) {
    ASSERT_EQ(contents((*received)[i]), "file " + std::to_string(i));
    ASSERT_NE(::fcntl((*received)[i].get(), F_GETFD) & FD_CLOEXEC, 0);
  }
  EXPECT_EQ(**pair.right.receive(), "after");
  sender.join();
}

TEST(MessageSocket, PartialMessageIsDataLoss) {
  auto ends = *socket_pair();
  MessageSocket right(std::move(ends.second));
  ASSERT_EQ(::write(ends.first.get(), "\x05\0\0\0abc", 7), 7);
  ends.first.reset();
  EXPECT_TRUE(absl::IsDataLoss(right.receive().status()));
  const auto end = right.receive();
  ASSERT_TRUE(end.ok());
  EXPECT_FALSE(end->has_value());
  EXPECT_TRUE(absl::IsUnavailable(right.send("anybody?")));
}

TEST(MessageSocket, ExcessLengthDoesNotAllocate) {
  auto ends = *socket_pair();
  MessageSocket right(std::move(ends.second));
  ASSERT_EQ(::write(ends.first.get(), "\xff\xff\xff\xff", 4), 4);
  EXPECT_TRUE(absl::IsDataLoss(right.receive().status()));
}

TEST(DescriptorReader, ReadsOnlyManifestFiles) {
  v1::SceneManifest manifest;
  std::vector<Descriptor> files;
  for (const std::string text : {"gltf", "", "short"}) {
    auto* entry = manifest.add_assets();
    entry->set_uri("uri of " + text);
    entry->mutable_asset()->set_size_bytes(text == "short" ? 100 : static_cast<int>(text.size()));
    files.push_back(file_with(text));
  }
  files.push_back(file_with(""));
  DescriptorReader reader(manifest, std::move(files), SceneMemory{});
  const auto bytes = reader.read("uri of gltf");
  ASSERT_TRUE(bytes.ok());
  EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes->data()), bytes->size()), "gltf");
  EXPECT_EQ(reader.read("uri of gltf")->data(), bytes->data()) << "mapped once";
  EXPECT_TRUE(reader.read("uri of ")->empty());
  EXPECT_TRUE(absl::IsNotFound(reader.read("/etc/passwd").status()));
  EXPECT_TRUE(absl::IsDataLoss(reader.read("uri of short").status()));
}

TEST(DescriptorReader, TexelsOverLimitAreSpilled) {
  const std::vector<std::byte> first(60, std::byte{1}), second(5000, std::byte{2});
  const Descriptor scratch = file_with("");
  const auto reader_of = [&](std::int64_t texel_bytes) {
    std::vector<Descriptor> files;
    files.emplace_back(::dup(scratch.get()));
    return std::make_unique<DescriptorReader>(v1::SceneManifest(), std::move(files),
                                              SceneMemory{texel_bytes, 0});
  };
  auto reader = reader_of(100);
  EXPECT_EQ(*reader->spill(first), nullptr) << "within the limit";
  auto aside = *reader->spill(second);
  ASSERT_NE(aside, nullptr);
  // Another reader of the file appends to it; both spilled images outlive their readers.
  reader = reader_of(0);
  const auto other = *reader->spill(first);
  reader.reset();
  EXPECT_TRUE(std::equal(second.begin(), second.end(), aside.get()));
  EXPECT_TRUE(std::equal(first.begin(), first.end(), other.get()));
  // Unused memory is unmapped.
  const std::byte* const was_at = aside.get();
  aside.reset();
  unsigned char resident = 0;
  EXPECT_EQ(::mincore(const_cast<std::byte*>(was_at), 1, &resident), -1);
}

TEST(RenderPool, LoopRunsEveryIndexOnce) {
  for (const int threads : {1, 2, 5}) {
    std::atomic<std::int64_t> helper_cpu_ns = 0;
    constexpr std::int64_t kCount = 1000;
    std::vector<std::atomic<int>> seen_inside(kCount), seen_outside(kCount);
    {
      RenderPool pool(threads);
      const auto loop = pool.parallel_for(helper_cpu_ns);
      pool.submit([&, loop] {  // by copy: the pool outlives this scope
        loop(kCount, [&](std::int64_t i) { ++seen_inside[static_cast<std::size_t>(i)]; });
      });
      loop(kCount, [&](std::int64_t i) { ++seen_outside[static_cast<std::size_t>(i)]; });
    }
    for (std::size_t i = 0; i < kCount; ++i) {
      ASSERT_EQ(seen_inside[i], 1) << i;
      ASSERT_EQ(seen_outside[i], 1) << i;
    }
  }
}

TEST(RenderPool, IdleThreadsHelpWithOnlyTask) {
  std::atomic<std::int64_t> helper_cpu_ns = 0;
  std::atomic<int> inside = 0;
  std::atomic<bool> met = false;
  {
    RenderPool pool(2);
    pool.submit([&] {
      // Each of the two bodies waits for the other: without a helper the first would never end.
      pool.parallel_for(helper_cpu_ns)(2, [&](std::int64_t) {
        ++inside;
        const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
        while (inside < 2 && std::chrono::steady_clock::now() < limit) std::this_thread::yield();
        if (inside == 2) met = true;
      });
    });
  }
  EXPECT_TRUE(met);
  EXPECT_GT(helper_cpu_ns, 0);
}

TEST(RenderPool, QueuedTasksPrecedeHelping) {
  std::atomic<std::int64_t> helper_cpu_ns = 0;
  std::atomic<int> done = 0;
  {
    RenderPool pool(3);
    for (int task = 0; task < 100; ++task) {
      pool.submit([&] { pool.parallel_for(helper_cpu_ns)(10, [&](std::int64_t) { ++done; }); });
    }
  }
  EXPECT_EQ(done, 1000);
}

/// A source that counts its calls.
struct Download {
  std::string bytes;
  int calls = 0;
  AssetCache::Source source() {
    return [this](const std::function<absl::Status(std::string_view)>& write) {
      ++calls;
      const std::size_t half = bytes.size() / 2;
      const absl::Status status = write(std::string_view(bytes).substr(0, half));
      return status.ok() ? write(std::string_view(bytes).substr(half)) : status;
    };
  }
};

std::size_t file_count(const std::string& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(AssetCache, DownloadsOncePerHost) {
  Folder folder;
  Download download{"a scene file"};
  const auto digest = contract::sha256(download.bytes);
  for (int worker = 0; worker < 2; ++worker) {
    const auto cache = *AssetCache::open(folder.path() + "/cache", 1000);
    for (int use = 0; use < 2; ++use) {
      const auto file = cache->get(digest, 12, download.source());
      ASSERT_TRUE(file.ok()) << file.status();
      EXPECT_EQ(contents(*file), "a scene file");
    }
  }
  EXPECT_EQ(download.calls, 1);
}

TEST(AssetCache, WrongBytesAreNeverServed) {
  Folder folder;
  const auto cache = *AssetCache::open(folder.path(), 1000);
  const auto digest = contract::sha256("the right bytes");
  for (const std::string wrong : {"the wrong byte!", "short", "far too many bytes are here"}) {
    Download download{wrong};
    EXPECT_TRUE(absl::IsDataLoss(cache->get(digest, 15, download.source()).status())) << wrong;
    EXPECT_EQ(file_count(folder.path()), 0u);
  }
}

TEST(AssetCache, DamagedFileIsFetchedAgain) {
  Folder folder;
  Download download{"a scene file"};
  const auto digest = contract::sha256(download.bytes);
  ASSERT_TRUE((*AssetCache::open(folder.path(), 1000))->get(digest, 12, download.source()).ok());
  std::ofstream(folder.path() + "/" + digest.hex()) << "a scene filf";
  const auto file = (*AssetCache::open(folder.path(), 1000))->get(digest, 12, download.source());
  ASSERT_TRUE(file.ok());
  EXPECT_EQ(contents(*file), "a scene file");
  EXPECT_EQ(download.calls, 2);
}

TEST(AssetCache, StalePartialFilesAreDeleted) {
  Folder folder;
  const auto cache = *AssetCache::open(folder.path(), 1000);
  const auto part_count = [&] {
    return std::count_if(fs::directory_iterator(folder.path()), fs::directory_iterator(),
                         [](const auto& entry) { return entry.path().extension() == ".part"; });
  };
  Download download{"a scene file"};
  const auto file = cache->get(contract::sha256(download.bytes), 12, [&](const auto& write) {
    EXPECT_TRUE(write("a scene").ok());
    std::ofstream(folder.path() + "/left.part") << "x";  // left by a killed worker
    EXPECT_EQ(part_count(), 2);
    EXPECT_TRUE(AssetCache::open(folder.path(), 1000).ok());  // another worker of this host
    EXPECT_EQ(part_count(), 1);
    return write(" file");
  });
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(contents(*file), "a scene file");
  EXPECT_EQ(part_count(), 0);
}

TEST(AssetCache, UnwritableDirectoryIsReported) {
  const auto cache = AssetCache::open("/proc/none", 1000);
  EXPECT_TRUE(absl::IsFailedPrecondition(cache.status())) << cache.status();
  EXPECT_EQ(cache.status().message().find("cache directory /proc/none: "), 0u) << cache.status();
}

TEST(AssetCache, EvictsLeastRecentlyUsed) {
  Folder folder;
  const auto cache = *AssetCache::open(folder.path(), 25);
  std::vector<Download> downloads = {{"first file"}, {"other file"}, {"third file"}};
  std::vector<Descriptor> files;
  for (Download& download : downloads) {
    auto file = cache->get(contract::sha256(download.bytes), 10, download.source());
    ASSERT_TRUE(file.ok());
    files.push_back(*std::move(file));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // distinct times on disk
    if (files.size() == 2) {
      ASSERT_TRUE(cache->get(contract::sha256("first file"), 10, downloads[0].source()).ok());
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  EXPECT_EQ(file_count(folder.path()), 2u);
  EXPECT_FALSE(fs::exists(folder.path() + "/" + contract::sha256("other file").hex()));
  EXPECT_EQ(contents(files[1]), "other file");
}

}  // namespace
}  // namespace tessera::agent
