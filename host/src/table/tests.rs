use super::*;
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::Field;

struct Stone {
    name: Option<&'static str>,
    weight_kg: Option<f64>,
    place: Geodetic,
}

impl Record for Stone {
    const COLUMNS: &'static [Column] = &[("name", Kind::Text), ("weight_kg", Kind::Real(2)), ("count", Kind::Integer)];

    fn cells(&self, into: &mut Vec<Value>) {
        into.push(self.name.map_or(Value::Empty, |name| Value::Text(name.into())));
        into.push(self.weight_kg.into());
        into.push(Value::Integer(-3));
    }

    fn shapes(&self) -> Vec<(&'static str, Shape)> {
        let [latitude, longitude, _] = self.place;
        let corner = |a: f64, b: f64| [latitude + a, longitude + b, 0.0];
        // Clockwise, seen from above.
        let outline = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        vec![("stone", Shape::Point(self.place)), ("field", Shape::Polygon(outline))]
    }

    fn vertex(&self) -> Option<(&'static str, Geodetic)> {
        Some(("way", self.place))
    }
}

fn stones() -> Vec<Stone> {
    vec![
        Stone { name: Some("grey, \"old\""), weight_kg: Some(1.006), place: [40.0, -77.0, 1.25] },
        Stone { name: None, weight_kg: Some(f64::NAN), place: [40.000_1, -77.0, 2.0] },
        Stone { name: Some("red"), weight_kg: None, place: [41.0, -77.0, 3.0] },
    ]
}

fn written(format: Format) -> Vec<u8> {
    let mut table = Table::new(format, Vec::new()).unwrap();
    for stone in stones() {
        table.row(&stone).unwrap();
    }
    table.finish().unwrap()
}

#[test]
fn names_tell_formats() {
    for (name, format) in [
        ("a.csv", Some(Format::Csv)),
        ("a", Some(Format::Csv)),
        ("a.PARQUET", Some(Format::Parquet)),
        ("a.geojson", Some(Format::GeoJson)),
        ("a.shp", None),
    ] {
        assert_eq!(Format::of(Path::new(name)), format, "{name}");
    }
}

#[test]
fn text_is_quoted_and_what_is_missing_is_empty() {
    let text = String::from_utf8(written(Format::Csv)).unwrap();
    assert_eq!(text, "name,weight_kg,count\n\"grey, \"\"old\"\"\",1.01,-3\n,,-3\nred,,-3\n");
}

#[test]
fn parquet_reads_back_with_its_nulls() {
    let reader = SerializedFileReader::new(file(&written(Format::Parquet))).unwrap();
    let rows: Vec<Vec<Field>> =
        reader.into_iter().map(|row| row.unwrap().into_columns().into_iter().map(|cell| cell.1).collect()).collect();
    assert_eq!(rows[0], [Field::Str("grey, \"old\"".to_owned()), Field::Double(1.01), Field::Long(-3)]);
    assert_eq!(rows[1], [Field::Null, Field::Null, Field::Long(-3)]);
    assert_eq!(rows[2], [Field::Str("red".to_owned()), Field::Null, Field::Long(-3)]);
}

#[test]
fn notes_of_a_parquet_file_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stones.parquet");
    let noted: [Note; 2] = [("from".into(), "the brook".to_owned()), ("bag".into(), "2".to_owned())];
    let mut table = Table::new(Format::Parquet, std::fs::File::create(&path).unwrap()).unwrap();
    stones().iter().for_each(|stone| table.row(stone).unwrap());
    table.finish_with(&noted).unwrap();
    assert_eq!(notes(&path).unwrap(), noted);
    std::fs::write(&path, b"no table").unwrap();
    assert!(notes(&path).is_err());
}

#[test]
fn a_table_longer_than_a_row_group_is_whole() {
    let mut table = Table::new(Format::Parquet, Vec::new()).unwrap();
    for i in 0..70_000 {
        table.row(&Stone { name: None, weight_kg: Some(f64::from(i)), place: [0.0; 3] }).unwrap();
    }
    let reader = SerializedFileReader::new(file(&table.finish().unwrap())).unwrap();
    assert_eq!(reader.metadata().num_row_groups(), 2);
    assert_eq!(reader.metadata().file_metadata().num_rows(), 70_000);
}

#[test]
fn geojson_has_points_polygons_and_lines_broken_at_gaps() {
    let json: serde_json::Value = serde_json::from_slice(&written(Format::GeoJson)).unwrap();
    assert_eq!(json["type"], "FeatureCollection");
    let features = json["features"].as_array().unwrap();
    let kinds: Vec<_> = features.iter().map(|one| one["geometry"]["type"].as_str().unwrap()).collect();
    // The third stone is a degree away: the line ends before it, and a line of one vertex is none.
    assert_eq!(kinds, ["Point", "Polygon", "Point", "Polygon", "Point", "Polygon", "LineString"]);
    assert_eq!(features[0]["geometry"]["coordinates"], serde_json::json!([-77.0, 40.0, 1.25]));
    assert_eq!(features[0]["properties"]["weight_kg"], 1.01);
    assert_eq!(features[2]["properties"]["name"], serde_json::Value::Null);
    let ring: Vec<[f64; 2]> = serde_json::from_value(features[1]["geometry"]["coordinates"][0].clone()).unwrap();
    let area: f64 = ring.windows(2).map(|w| w[0][0] * w[1][1] - w[1][0] * w[0][1]).sum();
    assert!(ring.len() == 5 && ring[0] == ring[4] && area > 0.0, "closed and counter-clockwise: {ring:?}");
}

#[test]
fn a_number_is_the_same_in_every_format_and_zero_has_no_sign() {
    // Halfway in decimals, but not in binary, where 7.005 lies below and 1.005 times 100 as well; beyond, what rounds to zero from below.
    let weights = [7.005, 1.005, 0.125, -0.125, 2.675, 1.115, 8.345, -0.001, -0.0, -0.004_999, 1e12 + 0.5];
    let stone = |weight| Stone { name: None, weight_kg: Some(weight), place: [40.0, -77.0, -0.0] };
    let written = |format| {
        let mut table = Table::new(format, Vec::new()).unwrap();
        weights.iter().for_each(|weight| table.row(&stone(*weight)).unwrap());
        table.finish().unwrap()
    };
    let text = String::from_utf8(written(Format::Csv)).unwrap();
    let of_text: Vec<f64> = text.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
    let rows = SerializedFileReader::new(file(&written(Format::Parquet))).unwrap().into_iter();
    let of_parquet: Vec<f64> = rows
        .map(|row| match row.unwrap().into_columns()[1].1 {
            Field::Double(weight) => weight,
            ref other => panic!("{other}"),
        })
        .collect();
    let json = String::from_utf8(written(Format::GeoJson)).unwrap();
    let parsed: serde_json::Value = serde_json::from_str(&json).unwrap();
    let points = parsed["features"].as_array().unwrap().iter().filter(|one| one["geometry"]["type"] == "Point");
    let of_json: Vec<f64> = points.map(|one| one["properties"]["weight_kg"].as_f64().unwrap()).collect();
    let bits = |numbers: &[f64]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
    assert_eq!(of_text, of_parquet);
    assert_eq!((bits(&of_text), bits(&of_text)), (bits(&of_parquet), bits(&of_json)), "also the sign of zero");
    assert!(!text.contains("-0.00") && !json.contains("-0.0"), "{text}{json}");
}

fn file(contents: &[u8]) -> std::fs::File {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(contents).unwrap();
    file
}
