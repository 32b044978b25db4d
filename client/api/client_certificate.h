#pragma once

#include <grpcpp/channel.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "rpc/certificate_renewer.h"
#include "rpc/certificates/certificate_dates.h"

namespace tessera::client {

/// The certificate with which a client calls a farm: renews it while the client runs, and tells
/// when its files hold another one than the connection. Warnings go to stderr, each text once.
class ClientCertificate {
 public:
  using WallTime = contract::WallTime;
  /// `folder`: of ca.crt, tls.crt and tls.key. `channel` returns the present connection; called on
  /// another thread.
  ClientCertificate(std::string folder, std::function<std::shared_ptr<grpc::Channel>()> channel);

  /// Starts to renew, at the first call. If the certificate is due, waits until an attempt has
  /// ended, at most for `timeout`, so that short commands renew it as well.
  void start(std::chrono::milliseconds timeout);

  /// Returns whether the connection has to be made again, because the certificate with which it was
  /// made has used up most of its life and its file has been replaced.
  bool is_replaced(WallTime now) const;
  /// Notes that the connection has been made again, with the files as they are.
  void note_connected();

  /// Returns an error that says what to do if the certificate has expired and `failure` may be due
  /// to that, else `failure`.
  absl::Status explain(const absl::Status& failure, WallTime now) const;

 private:
  void note_failure(const absl::Status& status);
  void warn(const std::string& text);
  std::string how_to_replace() const;

  const std::string folder_, path_;
  const std::function<std::shared_ptr<grpc::Channel>()> channel_;
  WallTime due_, end_;  // of the certificate of the connection
  std::mutex mutex_;
  std::string last_warning_;
  std::unique_ptr<contract::CertificateRenewer> renewer_;  // null before start()
};

}  // namespace tessera::client
