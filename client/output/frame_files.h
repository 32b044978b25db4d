#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"

namespace tessera::client {

/// Returns a file name for a job's name: characters other than [A-Za-z0-9._-] and a leading dot
/// become
/// '_'. Never empty.
std::string clean_name(const std::string& name);

/// Returns a path without its directory and its last extension.
std::string stem_of(const std::string& path);

/// Returns the format for the path's extension: .exr, .png, .jpg or .jpeg, in any case.
/// Errors: InvalidArgument, another extension.
absl::StatusOr<v1::FetchFrameRequest::Format> format_of(const std::string& path);

/// Inserts a frame number of at least four digits: "out.exr" and 7 give "out.0007.exr".
std::string with_frame_number(const std::string& path, std::int32_t frame);

/// A frame of a job to fetch, and its destination.
struct FrameFile {
  std::string job_id;
  std::int32_t frame = 0;
  std::string path;  // destination
  v1::FetchFrameRequest::Format format = v1::FetchFrameRequest::FORMAT_EXR;
  double exposure_ev = 0;
  bool partial = false;  // accept an unfinished frame
  bool force = false;    // replace a file with different content
};

struct FetchedFrame {
  v1::FrameHeader header;
  bool already_there = false;  // the file existed with the right digest
  std::string unfinished;      // why the frame cannot be fetched yet; empty: it was fetched
};

/// Downloads a frame to PATH.part, verifies it and renames it. Keeps an existing file with the
/// right digest. An unfinished frame is not an error.
///
/// Errors: AlreadyExists, a different file exists and `force` is false; DataLoss, the bytes do not
/// match their digest; FailedPrecondition, the file cannot be written; those of
/// FarmClient::fetch_frame.
absl::StatusOr<FetchedFrame> fetch_frame_file(FarmClient& client, const FrameFile& file);

/// Writes `text` to PATH.part, then renames it. Errors: FailedPrecondition, naming the path.
absl::Status write_text_file(const std::string& path, const std::string& text);

}  // namespace tessera::client
