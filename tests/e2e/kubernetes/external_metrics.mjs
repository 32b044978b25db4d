// An adapter of external metrics, such as prometheus-adapter is: serves
// tessera_pool_units_for_new_workers of deploy/kubernetes/autoscaled/adapter-rule.yaml from the metrics of one
// server. The label selector must name a pool, and nothing else but the namespace.
//
//   node external_metrics.mjs PORT KEY CERTIFICATE METRICS_URL
import {readFileSync} from 'node:fs';
import http from 'node:http';
import https from 'node:https';

const [port, key, certificate, url] = process.argv.slice(2);
const group = 'external.metrics.k8s.io/v1beta1';
const metric = 'tessera_pool_units_for_new_workers';

const scrape = () => new Promise((resolve, reject) => {
  http.get(url, (answer) => {
    let text = '';
    answer.on('data', (part) => { text += part; });
    answer.on('end', () => resolve(text));
  }).on('error', reject);
});

// An empty list, as that of the real adapter, for a pool without workers and jobs.
async function items(selector) {
  const labels = Object.fromEntries(selector.split(',').map((pair) => pair.split('=')));
  if (!labels.pool) throw new Error(`the selector "${selector}" names no pool`);
  const series = `${metric}{pool="${labels.pool}",tag=""} `;
  return (await scrape()).split('\n').filter((line) => line.startsWith(series)).map((line) => ({
    metricName: metric, metricLabels: {pool: labels.pool}, timestamp: new Date().toISOString(),
    value: line.slice(series.length)}));
}

async function answer(path, query) {
  if (path === `/apis/${group}`) {
    return {kind: 'APIResourceList', apiVersion: 'v1', groupVersion: group,
            resources: [{name: metric, singularName: '', namespaced: true, kind: 'ExternalMetricValueList', verbs: ['get']}]};
  }
  if (path === `/apis/${group}/namespaces/tessera/${metric}`) {
    return {kind: 'ExternalMetricValueList', apiVersion: group, metadata: {},
            items: await items(query.get('labelSelector') ?? '')};
  }
  return null;
}

https.createServer({key: readFileSync(key), cert: readFileSync(certificate)}, async (request, response) => {
  response.setHeader('content-type', 'application/json');
  try {
    const url = new URL(request.url, 'https://adapter');
    const document = await answer(url.pathname, url.searchParams);
    if (document === null) response.statusCode = 404;
    response.end(JSON.stringify(document ?? {}));
  } catch (error) {
    response.statusCode = 503;
    response.end(JSON.stringify({message: String(error)}));
  }
}).listen(Number(port), '0.0.0.0');
