use crossfall::terrain::{drive::*, mapper::*, scene::*};
use std::time::Instant;
fn main() {
    let mut scene = TerrainScene { frames: 36, ..Default::default() };
    let arg: Vec<String> = std::env::args().collect();
    scene.road.curb_height_m = arg.get(1).map_or(0.12, |a| a.parse().unwrap());
    scene.road.heading_deg = arg.get(2).map_or(0.0, |a| a.parse().unwrap());
    if arg.get(3).map(|s| s.as_str()) == Some("ramp") {
        scene.road.profile = vec![GradeKnot{at_m:0.0,grade:0.03},GradeKnot{at_m:40.0,grade:0.03},GradeKnot{at_m:44.0,grade:0.12},GradeKnot{at_m:100.0,grade:0.12}];
    }
    if arg.get(3).map(|s| s.as_str()) == Some("bump") {
        scene.road.bumps = vec![Bump{at_m:57.0,length_m:0.9,height_m:0.08},Bump{at_m:47.0,length_m:0.9,height_m:0.05}];
    }
    if arg.get(3).map(|s| s.as_str()) == Some("bend") { scene.road.curvature_per_m = 0.005; }
    let cache = format!("/tmp/probe_{}.bin", arg[1..].join("_"));
    let frames: Vec<_> = if std::path::Path::new(&cache).exists() {
        let b = std::fs::read(&cache).unwrap();
        let mut v = Vec::new(); let mut o = 0;
        let f8 = |o: usize| f64::from_le_bytes(b[o..o+8].try_into().unwrap());
        while o < b.len() {
            let n = f8(o) as usize; o += 8;
            let mut r = [[0.0;3];3]; for a in r.iter_mut().flatten() { *a = f8(o); o += 8; }
            let mut p = [0.0;3]; for a in &mut p { *a = f8(o); o += 8; }
            let pts: Vec<[f32;4]> = (0..n).map(|k| { let q = o + 16*k; [0,4,8,12].map(|d| f32::from_le_bytes(b[q+d..q+d+4].try_into().unwrap())) }).collect();
            o += 16*n;
            v.push((pts, crossfall::terrain::lidar::SensorPose{rotation:r,position:p}));
        }
        v
    } else {
        let t = Instant::now();
        let v: Vec<_> = (0..scene.frames).map(|i| { let f = scene.frame(i).unwrap(); (f.points, f.reported) }).collect();
        eprintln!("sim {:?} a frame, {} points", t.elapsed()/scene.frames, v[0].0.len());
        let mut b = Vec::new();
        for (pts, pose) in &v {
            b.extend((pts.len() as f64).to_le_bytes());
            for x in pose.rotation.iter().flatten().chain(&pose.position) { b.extend(x.to_le_bytes()); }
            for x in pts.iter().flatten() { b.extend(x.to_le_bytes()); }
        }
        std::fs::write(&cache, b).unwrap();
        v
    };
    let mut shop = Workshop::for_range(Default::default(), 75.0, 300_000);
    println!("bytes {}", shop.bytes());
    let mut m = shop.open().unwrap();
    m.keep_behind(false);
    let mut times = vec![];
    for (k, (p, pose)) in frames.iter().enumerate() {
        let t = Instant::now();
        let r = m.integrate(p, pose, 100_000, &[]);
        times.push(t.elapsed().as_secs_f64()*1e3);
        if k % 7 == 0 || r.refused.is_some() { println!("{k} {:.2} ms {r:?}", times[k]); }
    }
    times.sort_by(f64::total_cmp);
    println!("median {:.2} ms min {:.2}", times[times.len()/2], times[0]);
    let t = Instant::now(); m.refresh(); println!("refresh {:?}", t.elapsed());
    // evaluate
    let st = scene.station((frames.len()-1) as f64 * 0.1);
    let mut occs = vec![];
    let mut last_occ = 0.0; let mut last_imp = 0.0; let (mut ok_o, mut ok_i) = (true, true);
    for d in 8..76 {
        let d = d as f64;
        let cols: Vec<bool> = (0..40).map(|c| {
            let s = st + d - 4.0 + 0.2 * c as f64;
            let mut hit = false;
            for a in 0..4 { for b in 0..10 {
                let (x,y,_) = scene.road.place(s + 0.025 + 0.05*a as f64, scene.road.left_curb_m - 0.25 + 0.025 + 0.05*b as f64);
                if m.cell_at(x,y).is_some_and(|c| c.risk >= 128) { hit = true; }
            }}
            hit }).collect();
        let occ = cols.iter().filter(|c| **c).count() as f64 / 40.0;
        let mut run = 0; let mut most = 0; for c in &cols { if *c { run = 0 } else { run += 1; most = most.max(run) } }
        ok_o &= occ > 0.54; ok_i &= most < 10;
        if ok_o { last_occ = d } if ok_i { last_imp = d }
        if (d as i32) % 4 == 0 { occs.push(format!("{d}:{occ:.2}")); }
    }
    println!("{}", occs.join(" "));
    println!("occupancy to {last_occ} impassable to {last_imp}");
    let (mut n, mut f, mut err, mut en) = (0, 0, 0.0, 0);
    for si in -100..700 { for li in -28..29 {
        let (s, l) = (st + si as f64 * 0.1, li as f64 * 0.1);
        let (x, y, _) = scene.road.place(s, l);
        if scene.road.bumps.iter().any(|b| (b.at_m - s).abs() < 1.0) { continue }
        if let Some(c) = m.cell_at(x, y) { n += 1; if c.risk >= 128 { f += 1; if f < 6 { println!("false at s {:.1} l {l:.1} {c:?}", s - st); } }
          if let Some(h) = c.height { let e = m.elevation_m(h) - scene.road.height(x,y); err += e*e; en += 1; } }
    }}
    println!("false {f}/{n} = {:.4} %  elevation rms {:.4}", 100.0*f as f64/n as f64, (err/en as f64).sqrt());
    for d in (0..70).step_by(6) { let mut e = vec![]; let mut spread = vec![]; for si in d*10..(d+6)*10 { for li in -28..29 { let (s,l)=(st+si as f64*0.1, li as f64*0.1); let (x,y,_)=scene.road.place(s,l); let (cx,cy)=((x*10.0).floor()/10.0+0.05,(y*10.0).floor()/10.0+0.05); if let Some(c)=m.cell_at(x,y) { if let Some(h)=c.height { e.push(m.elevation_m(h)-scene.road.height(cx,cy)); spread.push(c.scatter_mm as f64); } } } }
      let n=e.len() as f64; let mean=e.iter().sum::<f64>()/n; let sd=(e.iter().map(|v|(v-mean)*(v-mean)).sum::<f64>()/n).sqrt(); println!("d {d} n {n} mean {:.1} mm sd {:.1} mm scatter {:.1}", mean*1e3, sd*1e3, spread.iter().sum::<f64>()/n); }
    for b in &scene.road.bumps {
        let mut cols = 0; let mut hit = 0; let mut cl = std::collections::BTreeMap::new();
        for li in -34..34 { cols += 1;
            let mut h = false;
            for si in -5..=5 { let (x,y,_) = scene.road.place(b.at_m + si as f64*0.1, li as f64*0.1+0.05); if let Some(c) = m.cell_at(x,y) { if c.risk>=128 { h = true; *cl.entry(c.class.name()).or_insert(0) += 1; } } }
            if h { hit += 1; } }
        println!("bump {} cm at {:.1} m: {:.0} % {cl:?}", b.height_m*100.0, b.at_m - st, 100.0*hit as f64/cols as f64);
    }
    let mut cl = std::collections::BTreeMap::new();
    for si in 0..400 { for li in -2..=2 { let (x,y,_) = scene.road.place(st+8.0+si as f64*0.1, scene.road.left_curb_m+li as f64*0.1); if let Some(c) = m.cell_at(x,y) { if c.risk>=128 { *cl.entry(c.class.name()).or_insert(0) += 1; } } } }
    println!("left curb classes {cl:?}");
}
