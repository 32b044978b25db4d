#include "server/service/asset_service.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "rpc/rpc_status.h"
#include "server/service/quotas/refusal.h"

namespace tessera::server {
namespace {

constexpr int kMaxAssets = 100'000;
constexpr std::size_t kChunkBytes = 1 << 20;
constexpr std::int64_t kMaxAssetBytes = std::int64_t{1} << 40;
/// Bytes of an upload after which they are synced. A sync of the journal may have to wait until the
/// disk has written what an upload has not synced.
constexpr std::int64_t kUnsyncedBytes = std::int64_t{1} << 20;

absl::Status no_such_asset() {
  return absl::NotFoundError("the asset has not been uploaded; upload it and repeat");
}

/// Answer to the reader of a damaged asset, which has been deleted with this outcome. To workers,
/// which return their units, a damaged asset is like a lost one.
absl::Status damaged_asset(const absl::Status& dropped) {
  if (dropped.ok()) {
    return absl::NotFoundError("the stored asset was damaged and has been deleted; upload it");
  }
  return absl::DataLossError(absl::StrCat("the stored asset is damaged and cannot be deleted: ",
                                          std::string(dropped.message())));
}

/// Makes the bytes of an upload durable here, so that the journal's thread finds nothing left to
/// write: the sync of a large file takes seconds, in which no result would be acknowledged. After
/// an error the file is deleted and never synced again.
absl::Status sync_upload(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return absl::UnavailableError("cannot open the upload; repeat it");
  const bool is_synced = ::fdatasync(fd) == 0;
  ::close(fd);
  if (is_synced) return absl::OkStatus();
  return absl::UnavailableError("the upload could not be written to disk; repeat it");
}

/// Stores received bytes if they match the announced digest: small assets from memory, large ones
/// from an upload file. All work is done by a pool, one message at a time.
class Upload final : public grpc::ServerReadReactor<v1::UploadAssetRequest> {
 public:
  /// `bulk`: for large assets.
  Upload(Coordinator& coordinator, const Access& access, IoPool& io, IoPool& bulk,
         const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        access_(access),
        bulk_(bulk),
        io_(&io),
        caller_(caller.value_or(Caller{})) {
    if (caller.ok()) {
      StartRead(&request_);
    } else {
      refuse(*this, caller.status());
    }
  }

  void OnReadDone(bool ok) override {
    io_->post([this, ok] { go_on(ok); });
  }

  void OnDone() override {
    caller_.stream.reset();  // before the call's context is gone
    io_->post([this] {
      output_.reset();
      if (is_counted_ && !is_stored_) coordinator_.assets().drop_upload(caller_.owner(), *digest_);
      if (!path_.empty() && !is_published_) std::remove(path_.c_str());
      delete this;
    });
  }

 private:
  void go_on(bool has_message) {
    if (!has_message) return complete();
    if (absl::Status status = take(); !status.ok()) return Finish(contract::to_rpc(status));
    StartRead(&request_);
  }

  absl::Status take() {
    if (request_.has_asset()) return begin(request_.asset());
    const std::string& chunk = request_.chunk();
    if (!digest_) return absl::InvalidArgumentError("the first message must contain the asset ID");
    if (chunk.empty() || chunk.size() > kChunkBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat("chunk: ", chunk.size(), " bytes, expected 1 to 1048576"));
    }
    received_bytes_ += static_cast<std::int64_t>(chunk.size());
    if (received_bytes_ > size_bytes_) {
      return absl::InvalidArgumentError("chunk: more bytes than asset.size_bytes");
    }
    hasher_.update(chunk);
    if (memory_) memory_->append(chunk);
    if (output_ && !output_->write(chunk.data(), static_cast<std::streamsize>(chunk.size()))) {
      return write_error();
    }
    if (!output_ || received_bytes_ - synced_bytes_ < kUnsyncedBytes) return absl::OkStatus();
    synced_bytes_ = received_bytes_;
    return output_->flush() ? sync_upload(path_) : write_error();
  }

  absl::Status begin(const v1::AssetId& asset) {
    if (digest_) return absl::InvalidArgumentError("asset: only allowed in the first message");
    digest_ = contract::Digest::from_binary(asset.sha256());
    if (!digest_) return absl::InvalidArgumentError("asset.sha256: expected 32 bytes");
    size_bytes_ = asset.size_bytes();
    if (size_bytes_ < 0 || size_bytes_ > kMaxAssetBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat("asset.size_bytes: ", size_bytes_, " is not in [0, 2^40]"));
    }
    if (coordinator_.assets().has_asset(*digest_)) return absl::OkStatus();
    if (absl::Status status = access_.count_upload(caller_, size_bytes_); !status.ok()) {
      return status;
    }
    absl::Status status =
        coordinator_.assets().begin_upload(caller_.owner(), *digest_, size_bytes_);
    if (!status.ok()) return status;
    is_counted_ = true;
    if (size_bytes_ <= coordinator_.assets().max_row_bytes()) {
      memory_.emplace();
      return absl::OkStatus();
    }
    const auto path = coordinator_.assets().new_upload_path();
    if (!path.ok()) return path.status();
    path_ = *path;
    output_.emplace(path_, std::ios::binary | std::ios::trunc);
    if (!*output_) return write_error();
    io_ = &bulk_;  // from the next message on
    return absl::OkStatus();
  }

  void complete() {
    if (!digest_) return fail("asset: missing");
    if (received_bytes_ != size_bytes_) {
      return fail(absl::StrCat("received ", received_bytes_, " of ", size_bytes_, " bytes"));
    }
    if (hasher_.finish() != *digest_) return fail("the bytes do not match asset.sha256");
    if (memory_) {
      return coordinator_.assets().add_asset(*digest_, *std::move(memory_),
                                             [this](const absl::Status& status) {
                                               is_stored_ = status.ok();
                                               Finish(contract::to_rpc(status));
                                             });
    }
    if (!output_) return Finish(grpc::Status::OK);
    output_->close();
    if (output_->fail()) {
      return Finish(contract::to_rpc(write_error()));
    }
    if (absl::Status status = sync_upload(path_); !status.ok()) {
      return Finish(contract::to_rpc(status));
    }
    coordinator_.assets().publish_asset(path_, *digest_, [this](const absl::Status& status) {
      is_published_ = is_stored_ = status.ok();
      Finish(contract::to_rpc(status));
    });
  }

  static absl::Status write_error() {
    return absl::ResourceExhaustedError(
        "cannot write the upload: the disk of the store may be full");
  }

  void fail(const std::string& message) {
    Finish(contract::to_rpc(absl::InvalidArgumentError(message)));
  }

  Coordinator& coordinator_;
  const Access& access_;
  IoPool& bulk_;
  IoPool* io_;
  Caller caller_;  // also its place in the table of open streams
  v1::UploadAssetRequest request_;
  std::optional<contract::Digest> digest_;
  std::int64_t size_bytes_ = 0, received_bytes_ = 0, synced_bytes_ = 0;
  contract::Hasher hasher_;
  // None of them: the asset already exists.
  std::optional<std::string> memory_;
  std::string path_;
  std::optional<std::ofstream> output_;
  bool is_published_ = false;
  bool is_counted_ = false, is_stored_ = false;  // towards the owner's quota; successfully
};

/// Sends the bytes of an asset. Deletes it if they are damaged or cannot be read, so that the next
/// submission of the scene uploads it again.
class Download final : public grpc::ServerWriteReactor<v1::DownloadAssetResponse> {
 public:
  Download(AssetCatalog& assets, IoPool& io, Caller caller)
      : assets_(assets), io_(io), caller_(std::move(caller)) {}

  void start(const contract::Digest& digest) {
    digest_ = digest;
    io_.post([this] {
      if (assets_.has_asset(digest_)) {
        input_ = assets_.open_asset(digest_);
      } else {
        assets_.note_lost(digest_);
      }
      if (input_.ok()) return send_next();
      Finish(
          contract::to_rpc(absl::IsNotFound(input_.status()) ? no_such_asset() : input_.status()));
    });
  }

  void OnWriteDone(bool ok) override {
    if (!ok) return Finish(contract::to_rpc(absl::CancelledError("client disconnected")));
    io_.post([this] { send_next(); });
  }

  void OnDone() override { delete this; }

 private:
  /// An empty asset is one empty message.
  void send_next() {
    const std::int64_t left = input_->size() - offset_;
    if (left == 0 && has_sent_) return Finish(grpc::Status::OK);
    std::string& chunk = *response_.mutable_chunk();
    chunk.resize(std::min(kChunkBytes, static_cast<std::size_t>(left)));
    if (!input_->read_at(offset_, chunk).ok()) return drop();
    hasher_.update(chunk);
    offset_ += static_cast<std::int64_t>(chunk.size());
    if (offset_ == input_->size() && hasher_.finish() != digest_) return drop();
    has_sent_ = true;
    StartWrite(&response_);
  }

  void drop() {
    assets_.drop_damaged(digest_, input_->stored_us(), [this](const absl::Status& dropped) {
      Finish(contract::to_rpc(damaged_asset(dropped)));
    });
  }

  AssetCatalog& assets_;
  IoPool& io_;
  const Caller caller_;  // holds its place in the table of open streams
  contract::Digest digest_;
  absl::StatusOr<AssetReader> input_ = no_such_asset();
  contract::Hasher hasher_;
  std::int64_t offset_ = 0;
  bool has_sent_ = false;
  v1::DownloadAssetResponse response_;
};

}  // namespace

grpc::ServerUnaryReactor* AssetService::FindMissingAssets(
    grpc::CallbackServerContext* context, const v1::FindMissingAssetsRequest* request,
    v1::FindMissingAssetsResponse* response) {
  absl::Status status = access_.admit(*context, "AssetService.FindMissingAssets").status();
  if (status.ok() && request->assets_size() > kMaxAssets) {
    status = absl::InvalidArgumentError("assets: more than 100000 IDs; split the list");
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (!status.ok()) {
    refuse(*reactor, status);
    return reactor;
  }
  // Looks at a row and a file for each asset.
  io_.post([this, reactor, request, response] {
    reactor->Finish(contract::to_rpc(find_missing(*request, *response)));
  });
  return reactor;
}

absl::Status AssetService::find_missing(const v1::FindMissingAssetsRequest& request,
                                        v1::FindMissingAssetsResponse& response) const {
  for (int i = 0; i < request.assets_size(); ++i) {
    const v1::AssetId& asset = request.assets(i);
    const auto digest = contract::Digest::from_binary(asset.sha256());
    if (!digest) {
      return absl::InvalidArgumentError(absl::StrCat("assets[", i, "].sha256: expected 32 bytes"));
    }
    if (!coordinator_.assets().has_asset(*digest)) *response.add_missing() = asset;
  }
  return absl::OkStatus();
}

grpc::ServerReadReactor<v1::UploadAssetRequest>* AssetService::UploadAsset(
    grpc::CallbackServerContext* context, v1::UploadAssetResponse* /*response*/) {
  return new Upload(coordinator_, access_, io_, bulk_,
                    access_.admit(*context, "AssetService.UploadAsset"));
}

/// Workers may read assets of jobs leased to them; admins and callers without certificate, all.
bool AssetService::may_read(const Caller& caller, const contract::Digest& digest) const {
  if (!caller.identity || caller.identity->role == Role::admin) return true;
  return coordinator_.assets().is_leased_asset(digest, caller.certificate());
}

grpc::ServerWriteReactor<v1::DownloadAssetResponse>* AssetService::DownloadAsset(
    grpc::CallbackServerContext* context, const v1::DownloadAssetRequest* request) {
  const auto caller = access_.admit(*context, "AssetService.DownloadAsset");
  auto* download = new Download(coordinator_.assets(), io_, caller.value_or(Caller{}));
  const auto digest = contract::Digest::from_binary(request->asset().sha256());
  if (!caller.ok()) {
    refuse(*download, caller.status());
  } else if (!digest) {
    download->Finish(
        contract::to_rpc(absl::InvalidArgumentError("asset.sha256: expected 32 bytes")));
  } else if (!may_read(*caller, *digest)) {
    download->Finish(contract::to_rpc(no_such_asset()));
  } else {
    download->start(*digest);
  }
  return download;
}

}  // namespace tessera::server
