MODULE offsets
  PERS tooldata tGun:=[TRUE,[[50,-30,250],[0.9437143641,0.1276794407,-0.1448781254,0.2685358228]],[12,[0,0,100],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[900,-400,120],[0.9380860126,0.0499192929,0.0096612762,-0.3426504879]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p10:=[[461.921,1581.755,1001.355],[0.75767605,0.11931039,0.45452722,0.45287640],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  PROC main()
    MoveJ Offs(p10,0,0,100),v500,z50,tGun\WObj:=wPart;
    MoveL p10,v100,fine,tGun\WObj:=wPart;
    MoveL RelTool(p10,0,0,-50\Rz:=30),v100,fine,tGun\WObj:=wPart;
    MoveL pHome,v100,fine,tGun\WObj:=wPart;
    grip;
  ENDPROC
ENDMODULE
