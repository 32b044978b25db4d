#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace tessera::contract {

/// Renews the certificate in the directory `folder` through `channel` if it is due: makes a key,
/// has it signed by the farm's authority, and replaces the files. Returns whether there is a new
/// certificate, which another process may have obtained.
///
/// `context`: of the call, to cancel it; used once. Errors: those of RenewCertificate, and of
/// certificate_files.h.
absl::StatusOr<bool> renew_certificate(const std::shared_ptr<grpc::Channel>& channel,
                                       const std::string& folder, grpc::ClientContext& context);

/// Keeps a program's certificate valid: a thread renews it when it is due, and retries after
/// failures.
class CertificateRenewer {
 public:
  struct Options {
    std::string folder;  // of ca.crt, tls.crt and tls.key
    /// Returns the channel to renew through.
    std::function<std::shared_ptr<grpc::Channel>()> channel;
    /// Called on the renewer's thread when there is a new certificate.
    std::function<void()> renewed;
    /// Called on the renewer's thread when an attempt has failed.
    std::function<void(const absl::Status&)> failed;
  };
  explicit CertificateRenewer(Options options);
  /// Cancels an attempt in progress.
  ~CertificateRenewer();
  CertificateRenewer(const CertificateRenewer&) = delete;
  CertificateRenewer& operator=(const CertificateRenewer&) = delete;

  /// Waits until the first look at the certificate has ended, with an attempt to renew it if that
  /// is due. Returns whether it has ended within `timeout`.
  bool await_first_look(std::chrono::milliseconds timeout);

 private:
  void run();
  absl::Status renew();
  std::chrono::milliseconds attempt();
  bool wait(std::chrono::milliseconds pause);

  const Options options_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_stopping_ = false, has_looked_ = false;
  grpc::ClientContext* running_ = nullptr;  // of an attempt in progress
  std::thread thread_;
};

}  // namespace tessera::contract
