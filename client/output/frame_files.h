#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"

namespace tessera::client {

/// Name of a job made safe as a file name: everything but [A-Za-z0-9._-] becomes '_'; never empty,
/// never starting with a dot.
std::string clean_name(const std::string& name);

/// A file's path without its folder and its last extension.
std::string stem_of(const std::string& path);

/// EXR, PNG or JPEG by the path's extension (.exr .png .jpg .jpeg, either case).
/// Errors: InvalidArgument, another extension.
absl::StatusOr<v1::FetchFrameRequest::Format> format_of(const std::string& path);

/// "out.exr" and 7 -> "out.0007.exr": at least four digits before the extension.
std::string with_frame_number(const std::string& path, std::int32_t frame);

/// What to do about one frame of a job.
struct FrameFile {
  std::string job_id;
  std::int32_t frame = 0;
  std::string path;  // where it goes
  v1::FetchFrameRequest::Format format = v1::FetchFrameRequest::FORMAT_EXR;
  double exposure_ev = 0;
  bool partial = false;  // take what there is
  bool force = false;    // replace a file of other content
};

struct FetchedFrame {
  v1::FrameHeader header;
  bool already_there = false;  // the file had the right digest and was left alone
  std::string unfinished;      // why there is nothing to fetch yet; empty: the file is there
};

/// Brings a frame to its file: written to PATH.part, verified, renamed. A file that is there
/// already with the right digest is left alone. A frame that is not finished is no error.
///
/// Errors: AlreadyExists, another file is there and `force` is off; DataLoss, the bytes do not
/// match their digest; Unavailable, PermissionDenied and so on from the file system, naming the
/// path; those of FarmClient::fetch_frame.
absl::StatusOr<FetchedFrame> fetch_frame_file(FarmClient& client, const FrameFile& file);

/// Writes `text` to PATH.part, then renames it. Errors name the path.
absl::Status write_text_file(const std::string& path, const std::string& text);

}  // namespace tessera::client
