"use strict";
// What if: the linear problem of the run, solved again here for other sizes and treatments of its sources. Same steps as
// the program: partition (unknowns with a prior in units of its factor), whitening, Householder QR, shares by source.
(() => {
  const holder = document.getElementById("what-if-data"), section = document.getElementById("what-if");
  if (!holder || !section) return;
  const model = JSON.parse(holder.textContent);
  const unpacked = {};
  const array = key => {
    if (!(key in model.arrays)) return key.endsWith("_true") ? array(key.slice(0, -5)) : null;  // the truth is as assumed
    if (!unpacked[key]) {
      const text = atob(model.arrays[key].data), bytes = new Uint8Array(text.length);
      for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
      unpacked[key] = { shape: model.arrays[key].shape, v: new Float64Array(bytes.buffer) };
    }
    return unpacked[key];
  };

  // ---- small dense algebra; matrices are arrays of Float64Array rows
  const zeros = (n, m) => Array.from({ length: n }, () => new Float64Array(m));
  const cut = (a, at) => { const [, n, m] = a.shape; return Array.from({ length: n }, (_, i) => a.v.subarray((at * n + i) * m, (at * n + i + 1) * m)); };
  const times = (A, B, m) => {  // (n, k) (k, m)
    const out = zeros(A.length, m ?? (B.length ? B[0].length : 0));
    for (let i = 0; i < A.length; i++) for (let k = 0; k < B.length; k++) {
      const a = A[i][k], row = B[k];
      if (a !== 0) for (let j = 0; j < row.length; j++) out[i][j] += a * row[j];
    }
    return out;
  };
  const transposed = (A, m = 0) => Array.from({ length: A.length ? A[0].length : m }, (_, j) => Float64Array.from(A, row => row[j]));
  const gram = A => times(A, transposed(A), A.length);  // A A^T
  const add = (K, L, f = 1) => { for (let i = 0; i < K.length; i++) for (let j = 0; j < K.length; j++) K[i][j] += f * L[i][j]; };
  const picked = (P, rows, columns, f) => rows.map(i => Float64Array.from(columns, j => f * P[i][j]));
  const factor = C => {  // lower L with L L^T = C; a component that is held exactly has a column of zeros
    const n = C.length, L = zeros(n, n);
    for (let j = 0; j < n; j++) {
      let pivot = C[j][j];
      for (let k = 0; k < j; k++) pivot -= L[j][k] ** 2;
      if (!(pivot > 1e-15 * C[j][j])) continue;
      L[j][j] = Math.sqrt(pivot);
      for (let i = j + 1; i < n; i++) {
        let sum = C[i][j];
        for (let k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
        L[i][j] = sum / L[j][j];
      }
    }
    return L;
  };
  const forward = (L, B) => {  // L^-1 B; zero where L holds
    const X = B.map(row => row.slice());
    for (let i = 0; i < L.length; i++) for (let c = 0; c < X[i].length; c++) {
      let sum = X[i][c];
      for (let k = 0; k < i; k++) sum -= L[i][k] * X[k][c];
      X[i][c] = L[i][i] > 0 ? sum / L[i][i] : 0;
    }
    return X;
  };

  // Householder QR of many rows, a chunk at a time: the upper triangle stays
  class Triangle {
    constructor(size, width) { this.size = size; this.width = width; this.rows = []; this.room = Math.max(64, 3 * width); }  // many at once: less is done twice
    push(row) { this.rows.push(row); if (this.rows.length >= this.room + this.width) this.reduce(); }
    reduce() {
      const A = this.rows, m = A.length, w = this.width;
      for (let j = 0; j < Math.min(m - 1, w); j++) {
        let norm = 0;
        for (let i = j; i < m; i++) norm += A[i][j] * A[i][j];
        norm = Math.sqrt(norm);
        if (norm === 0) continue;
        const alpha = A[j][j] > 0 ? -norm : norm, head = A[j][j] - alpha, square = norm * norm - A[j][j] * A[j][j] + head * head;
        const dot = new Float64Array(w);
        for (let c = j + 1; c < w; c++) dot[c] = head * A[j][c];
        for (let i = j + 1; i < m; i++) { const v = A[i][j], row = A[i]; if (v !== 0) for (let c = j + 1; c < w; c++) dot[c] += v * row[c]; }
        for (let c = j + 1; c < w; c++) { dot[c] *= 2 / square; A[j][c] -= dot[c] * head; }
        for (let i = j + 1; i < m; i++) { const v = A[i][j], row = A[i]; if (v !== 0) { for (let c = j + 1; c < w; c++) row[c] -= dot[c] * v; row[j] = 0; } }
        A[j][j] = alpha;
      }
      this.rows = A.slice(0, w);
    }
  }

  // measurements that fresh or time-correlated nuisances touch: their assumed noise, as an operator on rows
  const kept = array("what_if_rows");
  const n = kept ? kept.shape[0] : 0, s = model.parameters.length;
  const place = Object.fromEntries(model.sources.map((source, i) => [source.name, i]));
  const fresh = model.sources.filter(source => source.kind === "white");
  const slow = model.sources.filter(source => source.kind === "markov");
  const chainOf = (k, true_) => {
    const get = what => (true_ && array(`what_if_markov_${k}_true_${what}`)) || array(`what_if_markov_${k}_${what}`);
    return { rows: array(`what_if_markov_${k}_rows`).v, H: get("H").v, F: get("F").v, Q: get("Q").v, P0: get("P0").v, q: array(`what_if_markov_${k}_P0`).shape[0] };
  };
  const joined = parts => {  // chains that share a measurement become one; parts: [chain, variance factor]
    const groups = [];
    for (const part of parts) {
      const mine = new Set(part[0].rows), hit = groups.filter(g => g.some(([c]) => c.rows.some(r => mine.has(r))));
      for (const g of hit) groups.splice(groups.indexOf(g), 1);
      groups.push([...hit.flat(), part]);
    }
    return groups.map(group => {
      const rows = [...new Set(group.flatMap(([c]) => [...c.rows]))].sort((a, b) => a - b), at = new Map(rows.map((r, i) => [r, i]));
      const q = group.reduce((sum, [c]) => sum + c.q, 0), m = rows.length;
      const H = new Float64Array(m * 2 * q), F = new Float64Array(m * q * q), Q = new Float64Array(m * q * q), P0 = new Float64Array(q * q);
      for (let i = 0; i < m; i++) for (let j = 0; j < q; j++) F[(i * q + j) * q + j] = 1;
      let first = 0;
      for (const [c, k2] of group) {
        c.rows.forEach((row, i) => {
          const to = at.get(row);
          for (let a = 0; a < 2; a++) for (let b = 0; b < c.q; b++) H[(to * 2 + a) * q + first + b] = c.H[(i * 2 + a) * c.q + b];
          if (i > 0) for (let a = 0; a < c.q; a++) for (let b = 0; b < c.q; b++) {
            F[(to * q + first + a) * q + first + b] = c.F[(i * c.q + a) * c.q + b];
            Q[(to * q + first + a) * q + first + b] = k2 * c.Q[(i * c.q + a) * c.q + b];
          }
        });
        for (let a = 0; a < c.q; a++) for (let b = 0; b < c.q; b++) P0[(first + a) * q + first + b] = k2 * c.P0[a * c.q + b];
        first += c.q;
      }
      return { rows, H, F, Q, P0, q };
    });
  };
  const lower2 = (a, b, c) => { const l = Math.sqrt(a), m = b / l; return [l, m, Math.sqrt(c - m * m)]; };  // [[a, b], [b, c]]
  const whitener = set => {
    const R = new Float64Array(3 * n);
    const noise = array("what_if_rows_noise").v, label = array("what_if_rows_source").v;
    for (let i = 0; i < n; i++) {
      const k2 = set.size[label[i]] ** 2;
      R[3 * i] = k2 * noise[4 * i]; R[3 * i + 1] = k2 * noise[4 * i + 2]; R[3 * i + 2] = k2 * noise[4 * i + 3];
    }
    fresh.forEach((source, k) => {
      if (set.nuisance[source.name] !== "estimated") return;
      const N = array(`what_if_white_${k}`).v, k2 = set.size[place[source.name]] ** 2;
      for (let i = 0; i < n; i++) { R[3 * i] += k2 * N[4 * i]; R[3 * i + 1] += k2 * N[4 * i + 2]; R[3 * i + 2] += k2 * N[4 * i + 3]; }
    });
    const chains = joined(slow.map((source, k) => [source, k]).filter(([source]) => set.nuisance[source.name] === "estimated")
      .map(([source, k]) => [chainOf(k, false), set.size[place[source.name]] ** 2]));
    const L = Array.from({ length: n }, (_, i) => lower2(R[3 * i], R[3 * i + 1], R[3 * i + 2]));
    for (const chain of chains) {  // Kalman filter of the nuisance: innovation factors and gains
      const { rows, H, F, Q, q } = chain, m = rows.length;
      let P = Float64Array.from(chain.P0);
      chain.gain = new Float64Array(m * q * 2);
      for (let i = 0; i < m; i++) {
        if (i > 0) {
          const half = new Float64Array(q * q), next = new Float64Array(q * q);
          for (let a = 0; a < q; a++) for (let b = 0; b < q; b++) { const f = F[(i * q + a) * q + b]; if (f !== 0) for (let c = 0; c < q; c++) half[a * q + c] += f * P[b * q + c]; }
          for (let a = 0; a < q; a++) for (let b = 0; b < q; b++) { const f = F[(i * q + b) * q + a]; if (f !== 0) for (let c = 0; c < q; c++) next[c * q + b] += half[c * q + a] * f; }
          for (let a = 0; a < q * q; a++) next[a] += Q[i * q * q + a];
          P = next;
        }
        const PH = new Float64Array(2 * q);
        for (let a = 0; a < q; a++) for (let p = 0; p < 2; p++) for (let b = 0; b < q; b++) PH[a * 2 + p] += P[a * q + b] * H[(i * 2 + p) * q + b];
        const V = [0, 0, 0];
        for (let b = 0; b < q; b++) {
          V[0] += H[i * 2 * q + b] * PH[b * 2]; V[1] += H[(i * 2 + 1) * q + b] * PH[b * 2]; V[2] += H[(i * 2 + 1) * q + b] * PH[b * 2 + 1];
        }
        const row = rows[i], l = L[row] = lower2(R[3 * row] + V[0], R[3 * row + 1] + V[1], R[3 * row + 2] + V[2]);
        for (let a = 0; a < q; a++) {  // PH L^-T: the gain by whitened innovations
          const g0 = PH[a * 2] / l[0], g1 = (PH[a * 2 + 1] - l[1] * g0) / l[2];
          chain.gain[(i * q + a) * 2] = g0; chain.gain[(i * q + a) * 2 + 1] = g1;
        }
        const g = chain.gain;
        for (let a = 0; a < q; a++) for (let b = 0; b < q; b++) P[a * q + b] -= g[(i * q + a) * 2] * g[(i * q + b) * 2] + g[(i * q + a) * 2 + 1] * g[(i * q + b) * 2 + 1];
      }
    }
    const free = new Uint8Array(n).fill(1);
    for (const chain of chains) for (const row of chain.rows) free[row] = 0;
    return {
      whiten(Y, w) {  // L^-1 in place, Y (2 n, w)
        for (const { rows, H, F, q, gain } of chains) {
          let a = new Float64Array(q * w);
          rows.forEach((row, i) => {
            if (i > 0) {
              const next = new Float64Array(q * w);
              for (let x = 0; x < q; x++) for (let y = 0; y < q; y++) { const f = F[(i * q + x) * q + y]; if (f !== 0) for (let c = 0; c < w; c++) next[x * w + c] += f * a[y * w + c]; }
              a = next;
            }
            const u = Y[2 * row], v = Y[2 * row + 1], l = L[row];
            for (let x = 0; x < q; x++) { const h = H[i * 2 * q + x], k = H[(i * 2 + 1) * q + x]; for (let c = 0; c < w; c++) { u[c] -= h * a[x * w + c]; v[c] -= k * a[x * w + c]; } }
            for (let c = 0; c < w; c++) { u[c] /= l[0]; v[c] = (v[c] - l[1] * u[c]) / l[2]; }
            for (let x = 0; x < q; x++) { const g = gain[(i * q + x) * 2], h = gain[(i * q + x) * 2 + 1]; for (let c = 0; c < w; c++) a[x * w + c] += g * u[c] + h * v[c]; }
          });
        }
        for (let i = 0; i < n; i++) if (free[i]) {
          const u = Y[2 * i], v = Y[2 * i + 1], l = L[i];
          for (let c = 0; c < w; c++) { u[c] /= l[0]; v[c] = (v[c] - l[1] * u[c]) / l[2]; }
        }
      },
      adjoint(Y, w) {  // L^-T in place
        for (const { rows, H, F, q, gain } of chains) {
          let bar = new Float64Array(q * w);
          for (let i = rows.length - 1; i >= 0; i--) {
            const f = new Float64Array(q * w);
            if (i < rows.length - 1) for (let x = 0; x < q; x++) for (let y = 0; y < q; y++) { const t = F[((i + 1) * q + y) * q + x]; if (t !== 0) for (let c = 0; c < w; c++) f[x * w + c] += t * bar[y * w + c]; }
            const row = rows[i], u = Y[2 * row], v = Y[2 * row + 1], l = L[row];
            for (let x = 0; x < q; x++) { const g = gain[(i * q + x) * 2], h = gain[(i * q + x) * 2 + 1]; for (let c = 0; c < w; c++) { u[c] += g * f[x * w + c]; v[c] += h * f[x * w + c]; } }
            for (let c = 0; c < w; c++) { v[c] /= l[2]; u[c] = (u[c] - l[1] * v[c]) / l[0]; }
            bar = f;
            for (let x = 0; x < q; x++) { const h = H[i * 2 * q + x], k = H[(i * 2 + 1) * q + x]; for (let c = 0; c < w; c++) bar[x * w + c] -= h * u[c] + k * v[c]; }
          }
        }
        for (let i = 0; i < n; i++) if (free[i]) {
          const u = Y[2 * i], v = Y[2 * i + 1], l = L[i];
          for (let c = 0; c < w; c++) { v[c] /= l[2]; u[c] = (u[c] - l[1] * v[c]) / l[0]; }
        }
      },
    };
  };
  const spreadOf = (chain, G, d) => {  // covariance (d, d) of sum g_k^T H_k z_k
    const { rows, H, F, Q, P0, q } = chain, total = zeros(d, d);
    let a = new Float64Array(q * d);
    const sum = (M, from) => {
      for (let x = 0; x < q; x++) for (let y = 0; y < q; y++) {
        const t = M[from + x * q + y];
        if (t !== 0) for (let i = 0; i < d; i++) for (let j = 0; j < d; j++) total[i][j] += a[x * d + i] * t * a[y * d + j];
      }
    };
    for (let i = rows.length - 1; i >= 0; i--) {
      if (i < rows.length - 1) {
        const next = new Float64Array(q * d);
        for (let x = 0; x < q; x++) for (let y = 0; y < q; y++) { const t = F[((i + 1) * q + y) * q + x]; if (t !== 0) for (let c = 0; c < d; c++) next[x * d + c] += t * a[y * d + c]; }
        a = next;
      }
      for (let x = 0; x < q; x++) for (let p = 0; p < 2; p++) { const h = H[(i * 2 + p) * q + x]; for (let c = 0; c < d; c++) a[x * d + c] += h * G[2 * rows[i] + p][c]; }
      if (i > 0) sum(Q, i * q * q);
    }
    sum(P0, 0);
    return total;
  };

  // solve again: sizes by source, treatments of blocks and of fresh or slow nuisances -> shares by prediction and source
  const solve = set => {
    const inBlock = how => model.blocks.filter(b => how.includes(set.block[b.name])).flatMap(b => Array.from({ length: b.last - b.first }, (_, i) => b.first + i));
    const est = inBlock(["estimated"]), out = inBlock(["considered", "ignored"]);
    const isEst = new Set(est), isOut = new Set(out);
    const P = cut({ ...array("what_if_prior"), shape: [1, s, s] }, 0), Pt = cut({ ...array("what_if_prior_true"), shape: [1, s, s] }, 0);
    const priors = model.sources.map((source, i) => ({ source, k: set.size[i] })).filter(one => one.source.kind === "prior");
    const known = new Set(priors.flatMap(one => one.source.columns));
    const free = est.filter(c => !known.has(c));
    let sy = free.length;
    for (const one of priors) {
      one.inside = one.source.columns.filter(c => isEst.has(c));
      one.outside = one.source.columns.filter(c => isOut.has(c));
      one.L = factor(picked(P, one.inside, one.inside, one.k * one.k));
      one.first = sy;
      sy += one.inside.length;
    }
    const T = zeros(s, sy);  // rows of parameters not estimated stay zero
    free.forEach((c, i) => { T[c][i] = 1; });
    for (const one of priors) one.inside.forEach((c, i) => { for (let j = 0; j <= i; j++) T[c][one.first + j] = one.L[i][j]; });
    const width = sy + out.length;
    const few = est.map(c => [c, [...T[c].keys()].filter(j => T[c][j] !== 0)]);  // a block of a prior, or a single one
    const spread = row => {  // H row (s) -> [H T | H_out]
      const made = new Float64Array(width);
      for (const [c, at] of few) { const h = row[c], t = T[c]; if (h !== 0) for (const j of at) made[j] += h * t[j]; }
      out.forEach((c, j) => { made[sy + j] = row[c]; });
      return made;
    };
    const triangle = new Triangle(sy, width);
    for (let i = free.length; i < sy; i++) { const row = new Float64Array(width); row[i] = 1; triangle.push(row); }
    const noises = model.sources.filter(source => source.kind === "noise");
    const info = array("what_if_information"), infoTrue = array("what_if_information_true");
    noises.forEach((source, a) => {
      const k = set.size[place[source.name]];
      for (const row of cut(info, a)) triangle.push(spread(row).map(v => v / k));
    });
    let Y = null, operator = null;
    if (n) {
      operator = whitener(set);
      Y = Array.from({ length: 2 * n }, (_, i) => spread(kept.v.subarray(i * s, (i + 1) * s)));
      operator.whiten(Y, width);
      for (const row of Y) triangle.push(row.slice());
    }
    triangle.reduce();
    const R = triangle.rows;
    const lengths = Array.from({ length: sy }, (_, j) => { let sum = 0; for (let i = 0; i <= j && i < R.length; i++) sum += R[i][j] ** 2; return Math.sqrt(sum); });
    for (let j = 0; j < sy; j++) if (R.length <= j || !(Math.abs(R[j][j]) > 1e-13 * lengths[j])) return null;
    const back = B => {  // R^-1 B, B (sy, m)
      const X = B.map(row => row.slice());
      for (let i = sy - 1; i >= 0; i--) {
        for (let k = i + 1; k < sy; k++) { const r = R[i][k]; if (r !== 0) for (let c = 0; c < X[i].length; c++) X[i][c] -= r * X[k][c]; }
        for (let c = 0; c < X[i].length; c++) X[i][c] /= R[i][i];
      }
      return X;
    };
    const S = back(zeros(sy, sy).map((row, i) => { row[i] = 1; return row; }));
    const M = back(R.slice(0, sy).map(row => row.slice(sy)));
    // all predictions side by side: columns first[k] to first[k] + d of D
    const partials = model.predictions.map((_, k) => array(`what_if_partials_${k}`));
    const W = partials.flatMap(one => Array.from({ length: one.shape[0] }, (_, i) => one.v.subarray(i * s, (i + 1) * s))), D = W.length;
    let first = 0;
    const spans = partials.map(one => { const from = first; first += one.shape[0]; return { from, d: one.shape[0] }; });
    const shares = spans.map(({ d }) => model.sources.map(() => zeros(d, d)));
    const addProduct = (at, B, f) => {  // B (., D): f B^T B, block by block
      spans.forEach(({ from, d }, k) => {
        const share = shares[k][at];
        for (const row of B) for (let x = 0; x < d; x++) for (let y = 0; y < d; y++) share[x][y] += f * row[from + x] * row[from + y];
      });
    };
    const WT = times(W, T, sy), A = times(WT, S, sy), SAt = times(S, transposed(A), D);
    noises.forEach((source, a) => {
      const at = place[source.name], k = set.size[at];
      addProduct(at, times(cut(infoTrue, a).map(row => spread(row).subarray(0, sy)), SAt, D), 1 / (k * k));
    });
    if (n) {
      const G = Y.map(row => {
        const made = new Float64Array(D);
        for (let k = 0; k < sy; k++) { const v = row[k], from = SAt[k]; if (v !== 0) for (let c = 0; c < D; c++) made[c] += v * from[c]; }
        return made;
      });
      operator.adjoint(G, D);
      const quadratic = (at, N, i, f) => {
        const u = G[2 * i], v = G[2 * i + 1], a = f * N[4 * i], b = f * N[4 * i + 1], c = f * N[4 * i + 2], e = f * N[4 * i + 3];
        if (a === 0 && e === 0) return;
        for (let k = 0; k < spans.length; k++) {
          const { from, d } = spans[k], share = shares[k][at];
          for (let x = 0; x < d; x++) { const p = u[from + x], q = v[from + x]; for (let y = 0; y < d; y++) share[x][y] += (p * a + q * c) * u[from + y] + (p * b + q * e) * v[from + y]; }
        }
      };
      const label = array("what_if_rows_source").v, noise = array("what_if_rows_noise_true").v;
      for (let i = 0; i < n; i++) quadratic(label[i], noise, i, set.size[label[i]] ** 2);
      fresh.forEach((source, k) => {
        if (set.nuisance[source.name] === "fixed") return;
        const N = array(`what_if_white_${k}_true`).v, at = place[source.name], f = set.size[at] ** 2;
        for (let i = 0; i < n; i++) quadratic(at, N, i, f);
      });
      slow.forEach((source, k) => {
        const at = place[source.name];
        if (set.nuisance[source.name] === "fixed") return;
        const total = spreadOf(chainOf(k, true), G, D), f = set.size[at] ** 2;
        spans.forEach(({ from, d }, j) => { for (let x = 0; x < d; x++) for (let y = 0; y < d; y++) shares[j][at][x][y] += f * total[from + x][from + y]; });
      });
    }
    const WM = times(WT, M, out.length), number = new Map(out.map((c, j) => [c, j]));
    for (const one of priors) {
      const live = [...one.inside, ...one.outside];
      if (!live.length) continue;
      const draw = factor(picked(Pt, live, live, one.k * one.k));
      const inner = times(transposed(SAt.slice(one.first, one.first + one.inside.length), D), forward(one.L, draw.slice(0, one.inside.length)), live.length);
      const outer = W.map((row, i) => Float64Array.from(one.outside, c => WM[i][number.get(c)] - row[c]));
      const other = times(outer, draw.slice(one.inside.length), live.length);
      addProduct(place[one.source.name], transposed(inner.map((row, i) => row.map((v, j) => other[i][j] - v))), 1);
    }
    return spans.map((_, k) => ({ shares: shares[k] }));
  };
  const held = set => model.predictions.map((_, number) => {  // the estimator's own gain: shares grow with the square
    const all = array(`what_if_shares_${number}`);
    return { shares: model.sources.map((source, i) => source.share === null ? zeros(all.shape[1], all.shape[1]) : cut(all, source.share).map(row => row.map(v => v * set.size[i] ** 2))) };
  });

  // ---- what a covariance says
  const axesOf = K => {  // semi-axes, largest first, and the angle of the long one in a plane
    const d = K.length, A = K.map(row => Float64Array.from(row)), V = zeros(d, d).map((row, i) => { row[i] = 1; return row; });
    for (let sweep = 0; sweep < 30; sweep++) for (let p = 0; p < d; p++) for (let q = p + 1; q < d; q++) {
      if (A[p][q] === 0) continue;
      const t = 0.5 * Math.atan2(2 * A[p][q], A[q][q] - A[p][p]), c = Math.cos(t), z = Math.sin(t);
      for (let k = 0; k < d; k++) { const x = A[k][p], y = A[k][q]; A[k][p] = c * x - z * y; A[k][q] = z * x + c * y; }
      for (let k = 0; k < d; k++) { const x = A[p][k], y = A[q][k]; A[p][k] = c * x - z * y; A[q][k] = z * x + c * y; }
      for (let k = 0; k < d; k++) { const x = V[k][p], y = V[k][q]; V[k][p] = c * x - z * y; V[k][q] = z * x + c * y; }
      A[p][q] = A[q][p] = 0;
    }
    const order = A.map((_, i) => i).sort((i, j) => A[j][j] - A[i][i]);
    const axes = order.map(i => Math.sqrt(Math.max(0, A[i][i])));
    const angle = d === 2 ? Math.atan2(V[1][order[0]], V[0][order[0]]) * 180 / Math.PI : null;
    return { axes, angle: angle === null ? null : angle > 90 ? angle - 180 : angle <= -90 ? angle + 180 : angle };
  };
  const told = found => found.map(({ shares }) => {
    const d = shares[0].length, K = zeros(d, d);
    for (const share of shares) add(K, share);
    const sigma = K.map((row, i) => Math.sqrt(row[i]));
    return { K, shares: shares.map(share => share.reduce((sum, row, i) => sum + row[i], 0)), sigma, total: Math.hypot(...sigma), ...axesOf(K) };
  });

  // ---- controls and answers
  const make = (tag, attributes = {}, ...inside) => {
    const e = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    e.append(...inside);
    return e;
  };
  const draw = (tag, attributes) => {
    const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    return e;
  };
  const number = (v, digits = 4) => {
    if (v === 0) return "0";
    const size = Math.abs(v);
    const text = size >= 1e6 || size < 1e-3 ? v.toExponential(digits - 1).replace("e+", "e").replace("e", " × 10^") : Number(v.toPrecision(digits)).toString();
    return text.replace("-", "−");
  };
  const value = (v, unit, digits = 4) => { const e = make("data", { value: v }); e.textContent = unit ? `${number(v, digits)} ${unit}` : number(v, digits); return e; };
  const now = () => ({
    size: model.sources.map(() => 1),
    block: Object.fromEntries(model.blocks.map(block => [block.name, block.treatment])),
    nuisance: Object.fromEntries(model.sources.filter(source => source.treatment).map(source => [source.name, source.treatment])),
  });
  const HALF = 2;  // powers of ten that a slider reaches to each side
  const set = now();
  let way = model.reason ? "held" : "solved", chosen = 0, asked = 0;
  const tool = section.querySelector(".what-if-tool");
  const ways = make("fieldset", { class: "ways" }, make("legend", {}, "Gain"));
  for (const [name, words] of [["held", "as it is"], ["solved", "re-optimised"]]) {
    const box = make("input", { type: "radio", name: "what-if-gain", value: name });
    box.checked = name === way;
    box.disabled = name === "solved" && Boolean(model.reason);
    box.addEventListener("change", () => { way = name; update(); });
    ways.append(make("label", {}, box, words));
  }
  const reset = make("button", { type: "button" }, "as the mission says");
  const controls = [];
  const written = v => { const w = Number(v.toPrecision(4)); return w !== 0 && (w >= 1e6 || w < 1e-4) ? w.toExponential() : String(w); };
  const rows = model.sources.map((source, i) => {
    const slider = make("input", { type: "range", min: -HALF, max: HALF, step: 0.01, "aria-label": `${source.name}: size`, "data-source": source.name });
    const field = make("input", { type: "number", min: 0, step: "any", "aria-label": `${source.name}: ${source.size ? "sigma, " + source.size.unit : "times as large"}`, "data-source": source.name });
    const unit = source.size ? source.size.sigma : 1, smallest = source.kind === "noise" ? 1e-6 : 0;
    const put = () => {
      if (document.activeElement !== field) field.value = written(unit * set.size[i]);
      if (document.activeElement !== slider) slider.value = set.size[i] > 0 ? Math.log10(set.size[i]) : -HALF;
    };
    slider.addEventListener("input", () => { set.size[i] = 10 ** Number(slider.value); put(); later(); });
    field.addEventListener("input", () => {
      const typed = Number(field.value) / unit;
      if (field.value === "" || !Number.isFinite(typed) || typed < 0) return;
      set.size[i] = Math.max(smallest, typed);
      put();
      later();
    });
    const choices = make("td");
    const choose = (key, name, options) => {
      const list = make("select", { "aria-label": `${name}: treatment`, "data-of": name });
      for (const option of options) list.append(make("option", { value: option }, option));
      list.addEventListener("change", () => { set[key][name] = list.value; later(); });
      controls.push(() => { list.value = set[key][name]; list.disabled = way === "held"; });
      return list;
    };
    const every = ["estimated", "considered", "ignored", "fixed"];
    if (!model.reason && source.treatment) choices.append(choose("nuisance", source.name, every));
    const joint = source.blocks.length > 1;
    for (const name of model.reason ? [] : source.blocks) {
      if (name === "state") continue;
      choices.append(...(joint ? [make("label", {}, `${name} `, choose("block", name, every.slice(0, 3)))] : [choose("block", name, every)]));
    }
    const share = make("td", { class: "r" });
    controls.push(put);
    return { share, row: make("tr", {}, make("th", { scope: "row" }, make("span", {}, source.name), slider),
      make("td", { class: "size" }, source.size ? "" : "× ", field, source.size ? ` ${source.size.unit}` : ""), choices, share) };
  });
  const loose = model.reason ? [] : model.blocks.filter(block => !block.prior && block.name !== "state");
  for (const block of loose) {  // nothing is known of it beforehand: no size, but it may be held
    const list = make("select", { "aria-label": `${block.name}: treatment`, "data-of": block.name });
    for (const option of ["estimated", "fixed"]) list.append(make("option", { value: option }, option));
    list.addEventListener("change", () => { set.block[block.name] = list.value; later(); });
    controls.push(() => { list.value = set.block[block.name]; list.disabled = way === "held"; });
    rows.push({ share: null, row: make("tr", {}, make("th", { scope: "row" }, block.name), make("td", { class: "size" }, "no prior"), make("td", {}, list), make("td")) });
  }
  const shareHead = make("th", { scope: "col", class: "r" });
  const sources = make("table", { class: "sliders" }, make("thead", {}, make("tr", {}, ...["source", "sigma"].map(text => make("th", { scope: "col" }, text)), make("th", { scope: "col" }, "treatment"), shareHead)),
    make("tbody", {}, ...rows.map(one => one.row)));
  const answers = model.predictions.map((prediction, k) => {
    const cells = { now: make("td", { class: "r" }), then: make("td", { class: "r" }), ratio: make("td", { class: "r" }), axes: make("td") };
    const head = make("th", { scope: "row" });
    if (model.predictions.length > 1) {
      const pick = make("input", { type: "radio", name: "what-if-shown", value: k });
      pick.checked = k === chosen;
      pick.addEventListener("change", () => { chosen = k; update(); });
      head.append(make("label", {}, pick, ` ${prediction.name}`));
    } else head.append(prediction.name);
    head.title = prediction.plane;
    return { ...cells, row: make("tr", { "data-prediction": prediction.name }, head, cells.now, cells.then, cells.ratio, cells.axes) };
  });
  const outcome = make("table", { class: "outcome" }, make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "prediction"),
    ...["now, total 1σ", "what if", "ratio"].map(t => make("th", { scope: "col", class: "r" }, t)), make("th", { scope: "col" }, "semi-axes, 1σ"))), make("tbody", {}, ...answers.map(one => one.row)));
  const said = make("p", { class: "what-if-said", role: "status" });
  const picture = make("figure"), caption = make("figcaption");
  const svg = draw("svg", { viewBox: "0 0 320 240", role: "img", "aria-label": "Ellipse now and what if" });
  picture.append(make("div", { class: "what-if-picture" }, svg), caption);
  const scrolled = (table, name) => make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": name }, table);
  tool.append(make("div", { class: "what-if-head" }, ways, reset), scrolled(sources, "Sources"), said, scrolled(outcome, "Predictions, what if"), picture);

  const first = told(model.reason ? held(now()) : solve(now()));
  const ellipse = (found, scale, attributes) => {
    const path = [], t = Math.PI / 180 * found.angle;
    for (let i = 0; i <= 90; i++) {
      const a = i * Math.PI / 45, x = found.axes[0] * Math.cos(a), y = found.axes[1] * Math.sin(a);
      path.push(`${i ? "L" : "M"}${(160 + scale * (x * Math.cos(t) - y * Math.sin(t))).toFixed(2)} ${(110 - scale * (x * Math.sin(t) + y * Math.cos(t))).toFixed(2)}`);
    }
    svg.append(draw("path", { d: path.join(""), ...attributes }));
  };
  const percent = part => part === 0 ? "0 %" : part < 1e-4 ? "< 0.01 %" : `${(100 * part).toPrecision(part < 0.1 ? 2 : 3)} %`;
  const show = found => {
    const prediction = model.predictions[chosen], was = first[chosen], is = found[chosen];
    svg.replaceChildren();
    picture.hidden = was.sigma.length !== 2;
    if (picture.hidden) return;
    const scale = 96 / Math.max(was.axes[0], is.axes[0], 1e-300);
    svg.append(draw("path", { d: "M40 110H280M160 6V214", class: "grid" }));
    ellipse(was, scale, { fill: "none", stroke: "#767676", "stroke-width": 1.4, "stroke-dasharray": "4 3" });
    ellipse(is, scale, { fill: "#0072b2", "fill-opacity": 0.18, stroke: "#0072b2", "stroke-width": 1.8 });
    const power = 10 ** Math.floor(Math.log10(80 / scale)), length = [5, 2, 1].map(k => k * power).find(v => v * scale <= 80);
    svg.append(draw("path", { d: `M20 228h${length * scale}M20 224v8M${20 + length * scale} 224v8`, stroke: "#1a1a1a", fill: "none" }));
    const words = [[24 + length * scale + 4, 232, "start", `${number(length)} ${prediction.unit}`], [...(prediction.axes[0].length > 4 ? [318, 103, "end"] : [284, 114, "start"]), prediction.axes[0]], [164, 14, "start", prediction.axes[1]]];
    for (const [x, y, anchor, text] of words) { const t = draw("text", { x, y, "text-anchor": anchor }); t.textContent = text; svg.append(t); }
    svg.setAttribute("aria-label", `Ellipse of ${prediction.name} now and what if`);
    caption.textContent = `1σ ellipse of ${prediction.name} (${prediction.plane}): dashed now, ${was.axes.map(a => number(a, 3)).join(" × ")} ${prediction.unit}; blue what if, ${is.axes.map(a => number(a, 3)).join(" × ")} ${prediction.unit}.`;
  };
  function update() {
    asked = 0;
    for (const put of controls) put();
    const started = performance.now();
    const answer = way === "held" ? held(set) : solve(set);
    const found = answer && told(answer);
    shareHead.textContent = `share of ${model.predictions[chosen].name}`;
    if (!found) {
      said.textContent = "Not observable: so the measurements do not determine all that is estimated.";
      for (const cells of answers) { cells.then.textContent = "—"; cells.ratio.textContent = ""; cells.axes.textContent = ""; }
      for (const one of rows) if (one.share) one.share.textContent = "";
      picture.hidden = true;
      return;
    }
    found.forEach((is, k) => {
      const cells = answers[k], unit = model.predictions[k].unit;
      cells.now.replaceChildren(value(first[k].total, unit));
      cells.then.replaceChildren(value(is.total, unit));
      cells.ratio.textContent = `× ${number(is.total / first[k].total, 3)}`;
      cells.axes.replaceChildren(...is.axes.flatMap((a, i) => i ? [" × ", value(a, i === is.axes.length - 1 ? unit : "")] : [value(a, is.axes.length === 1 ? unit : "")]));
      if (is.angle !== null) cells.axes.append(" at ", value(is.angle, "deg", 3));
    });
    const all = found[chosen].total ** 2;
    rows.forEach((one, i) => { if (one.share) one.share.textContent = percent(all > 0 ? found[chosen].shares[i] / all : 0); });
    const changed = model.sources.some((_, i) => set.size[i] !== 1) || JSON.stringify([set.block, set.nuisance]) !== JSON.stringify([now().block, now().nuisance]);
    const k = chosen, unit = model.predictions[k].unit;
    said.textContent = changed ? `${model.predictions[k].name}: ${number(first[k].total, 3)} → ${number(found[k].total, 3)} ${unit} total 1σ, ${way === "held" ? "gain as it is" : "re-optimised"}.` : `As the mission says: ${model.predictions[k].name} ${number(first[k].total, 3)} ${unit} total 1σ.`;
    show(found);
    section.dataset.milliseconds = (performance.now() - started).toFixed(1);
  }
  const later = () => { if (!asked) asked = setTimeout(update, 0); };
  reset.addEventListener("click", () => { Object.assign(set, now()); update(); });
  section.whatIf = { model, set, solve: wanted => { const found = solve(wanted); return found && told(found); }, held: wanted => told(held(wanted)), now, update };
  section.hidden = false;
  update();
})();
