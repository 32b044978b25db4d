#include "client/output/frame_files.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/digest.h"

namespace tessera::client {
namespace {

absl::Status file_error(const std::string& path, const char* action) {
  return absl::FailedPreconditionError(
      absl::StrCat(path, ": ", action, ": ", std::strerror(errno)));
}

std::optional<contract::Digest> digest_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  contract::Hasher hasher;
  std::string buffer(1 << 20, '\0');
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) ||
         file.gcount() > 0) {
    hasher.update(std::string_view(buffer.data(), static_cast<std::size_t>(file.gcount())));
  }
  return hasher.finish();
}

bool exists(const std::string& path) {
  struct stat info {};
  return ::lstat(path.c_str(), &info) == 0;
}

/// A file being written as PATH.part; removed unless keep() is called.
class PartFile {
 public:
  explicit PartFile(const std::string& path) : path_(path), part_(path + ".part") {}
  ~PartFile() {
    if (file_ == nullptr) return;
    std::fclose(file_);
    ::unlink(part_.c_str());
  }
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;

  absl::Status start() {
    if (file_ != nullptr) std::fclose(file_);
    file_ = std::fopen(part_.c_str(), "wb");
    hasher_ = contract::Hasher();
    return file_ == nullptr ? file_error(part_, "cannot write") : absl::OkStatus();
  }
  absl::Status write(std::string_view bytes) {
    hasher_.update(bytes);
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_) == bytes.size()) return absl::OkStatus();
    return file_error(part_, "cannot write");
  }
  contract::Digest digest() { return hasher_.finish(); }
  absl::Status keep() {
    const bool flushed = std::fflush(file_) == 0;
    const bool closed = std::fclose(std::exchange(file_, nullptr)) == 0;
    if (flushed && closed && std::rename(part_.c_str(), path_.c_str()) == 0) {
      return absl::OkStatus();
    }
    absl::Status status = file_error(path_, "cannot write");
    ::unlink(part_.c_str());
    return status;
  }

 private:
  const std::string path_, part_;
  std::FILE* file_ = nullptr;
  contract::Hasher hasher_;
};

}  // namespace

std::string clean_name(const std::string& name) {
  std::string clean;
  for (const char c : name) {
    const bool is_allowed =
        absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' || c == '-';
    clean += is_allowed && !(clean.empty() && c == '.') ? c : '_';
  }
  return clean.empty() ? "_" : clean;
}

std::string stem_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
  const std::size_t dot = name.rfind('.');
  if (dot != std::string::npos && dot > 0) name.resize(dot);
  return name;
}

absl::StatusOr<v1::FetchFrameRequest::Format> format_of(const std::string& path) {
  const std::size_t dot = path.rfind('.');
  std::string extension = dot == std::string::npos ? "" : path.substr(dot);
  absl::AsciiStrToLower(&extension);
  if (extension == ".exr") return v1::FetchFrameRequest::FORMAT_EXR;
  if (extension == ".png") return v1::FetchFrameRequest::FORMAT_PNG;
  if (extension == ".jpg" || extension == ".jpeg") return v1::FetchFrameRequest::FORMAT_JPEG;
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": unsupported image format; use .exr, .png, .jpg or .jpeg"));
}

std::string with_frame_number(const std::string& path, std::int32_t frame) {
  const std::size_t slash = path.rfind('/');
  std::size_t dot = path.rfind('.');
  if (dot == std::string::npos || (slash != std::string::npos && dot < slash)) dot = path.size();
  return absl::StrCat(path.substr(0, dot), absl::StrFormat(".%04d", frame), path.substr(dot));
}

absl::StatusOr<FetchedFrame> fetch_frame_file(FarmClient& client, const FrameFile& file) {
  v1::FetchFrameRequest request;
  request.set_job_id(file.job_id);
  request.set_frame(file.frame);
  request.set_format(file.format);
  request.set_exposure_ev(file.exposure_ev);
  request.set_allow_partial(file.partial);
  FetchedFrame fetched;
  PartFile part(file.path);
  FarmClient::FrameSink sink;
  bool started = false;
  sink.start = [&](const v1::FrameHeader& header) {
    started = true;
    fetched.header = header;
    if (exists(file.path)) {
      const auto present = digest_of(file.path);
      fetched.already_there = present && present->binary() == header.file_sha256();
      if (fetched.already_there) return absl::AlreadyExistsError("");
      if (!file.force) {
        return absl::AlreadyExistsError(
            absl::StrCat(file.path, ": a different file exists; use --force to overwrite"));
      }
    }
    return part.start();
  };
  sink.write = [&](std::string_view bytes) { return part.write(bytes); };
  absl::Status status = client.fetch_frame(request, sink);
  if (fetched.already_there) return fetched;
  if (!started && absl::IsFailedPrecondition(status)) {
    fetched.unfinished = std::string(status.message());
    return fetched;
  }
  if (!status.ok()) return status;
  if (part.digest().binary() != fetched.header.file_sha256()) {
    return absl::DataLossError(absl::StrCat(file.path,
                                            ": the received bytes do not match their "
                                            "digest; fetch again"));
  }
  if (absl::Status kept = part.keep(); !kept.ok()) return kept;
  return fetched;
}

absl::Status write_text_file(const std::string& path, const std::string& text) {
  PartFile part(path);
  if (absl::Status status = part.start(); !status.ok()) return status;
  if (absl::Status status = part.write(text); !status.ok()) return status;
  return part.keep();
}

}  // namespace tessera::client
